"""`ident export`: what is refused."""

import pytest
from commands import files


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.fit.json", "--out=fitted.xml"), "none.fit.json: got no such file"),
        (("arm.toml", "--out=fitted.xml"), "arm.toml"),
        (("other.json", "--out=fitted.xml"), "other.json"),
    ],
)
def test_what_is_no_result_is_one_line_and_nothing_is_written(run, tmp_path, arguments, words):
    (tmp_path / "arm.toml").write_text('format = "ident-arm/1"')
    (tmp_path / "other.json").write_text('{"format": "ident-export/1"}')
    before = files(tmp_path)
    code, out, err = run("export", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == before
