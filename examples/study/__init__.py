"""Studies with people: stimuli, trial lists, analysis, and simulated participants to rehearse with."""

from .analysis import abx_dprime, abx_proportion_correct, analyse
from .folder import Study, make_study, read_answers, read_study
from .simulated import Population, power, simulate_participants
from .stimuli import BASELINES, Stimuli, StimulusSettings, make_stimuli
from .study_report import report_markdown, write_report
from .trials import TASKS, check_responses, participant_trials, read_tables

__all__ = [
    "BASELINES",
    "TASKS",
    "Population",
    "Stimuli",
    "StimulusSettings",
    "Study",
    "abx_dprime",
    "abx_proportion_correct",
    "analyse",
    "check_responses",
    "make_stimuli",
    "make_study",
    "participant_trials",
    "power",
    "read_answers",
    "read_study",
    "read_tables",
    "report_markdown",
    "simulate_participants",
    "write_report",
]
