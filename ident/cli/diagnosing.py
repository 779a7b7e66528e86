"""`ident diagnose`: it prints stage by stage, and gives back what a stage leaves behind."""

import gc
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ident.cli import running
from ident.cli.command import (
    ArmOption,
    CampaignArgument,
    OutOption,
    PathOption,
    StrictOption,
    command,
    leave,
    write,
)
from ident.cli.output import output
from ident.studies.diagnose import DiagnoseOptions, DiagnoseResult, check_browser, diagnose, discard, part_folder
from ident.studies.diagnose_stages import STAGES

if TYPE_CHECKING:
    from ident.studies.diagnose_stages import StageReport


@command(DiagnoseOptions)
def diagnose_command(
    campaign: CampaignArgument,
    options: DiagnoseOptions,
    arm: ArmOption = None,
    path: PathOption = None,
    restart: Annotated[bool, typer.Option("--restart", help="throw away the stages of an unfinished run")] = False,
    out: OutOption = Path("out"),
    pdf: Annotated[bool, typer.Option("--pdf", help="print the page as PDF as well, by Chromium")] = False,
    strict: StrictOption = False,
) -> None:
    """Find out whether an arm vibrates too far and which change helps: from a campaign to advice, step by step.

    The paper's procedure: stiffnesses, natural frequencies along the motion, resonance, vibration against the limit,
    torsional stiffness first and mass centres second. Goes on where an earlier run of the same inputs was stopped.
    Writes CAMPAIGN.diagnose.html, which opens without a network, CAMPAIGN.diagnose.json and the posterior with all
    results, CAMPAIGN.diagnose.nc. Exit status 3 where the posterior's chains are too short.
    """
    if pdf:
        check_browser()
    result = run_diagnose(campaign, options, arm, path, restart, out, pdf=pdf)
    leave(result, strict=strict)


def run_diagnose(
    campaign: Path,
    options: DiagnoseOptions,
    arm: Path | None,
    path: Path | None,
    restart: bool,
    out: Path,
    *,
    pdf: bool = False,
) -> DiagnoseResult:
    """Diagnose an arm, print each stage when it is finished, and write the result into a folder."""
    measured, arm_file = running.read(campaign, arm)
    import jax

    folder, stages = part_folder(out, measured), list(STAGES)

    def finished(report: "StageReport") -> None:
        output().say(str(report))
        if stages[report.number - 1] in ("trust", "vibration", "sensitivities"):
            jax.clear_caches()  # most programs of the next stage are new
            gc.collect()
        running.glibc("malloc_trim", 0)  # with few heaps (`running.start`) 1.0 instead of 1.3 GB

    try:
        result = diagnose(
            arm_file,
            measured,
            options,
            path=path,
            folder=folder,
            restart=restart,
            progress=running.progress,
            on_stage=finished,
        )
    except KeyboardInterrupt:
        typer.echo(f"stopped; kept {folder}: the same command goes on from there", err=True)
        raise typer.Exit(130) from None
    output().say(result.closing)
    output().document = result.document
    write(result, out, [lambda folder: (result.save_pdf(folder),)] if pdf else [])
    running.discard_unless_taken(folder, discard)
    return result
