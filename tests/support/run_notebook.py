"""Runs a notebook's script as plain Python, with short chains: python run_notebook.py SCRIPT."""

import runpy
import sys
from dataclasses import replace

import quickly  # noqa: F401

import ident

STEPS = 500
sample = ident.sample


def short(arm, campaign, options=None, **more):
    return sample(arm, campaign, replace(options or ident.SampleOptions(), steps=STEPS), **more)


ident.sample = short
runpy.run_path(sys.argv[1], run_name="__main__")
