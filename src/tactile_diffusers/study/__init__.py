"""Studies with people: stimuli, trial lists, analysis, and simulated participants to rehearse with."""

from .analysis import analyse
from .folder import Study, read_study
from .make import make_study, read_answers
from .responses import check_responses, read_tables
from .sensitivity import abx_dprime, abx_proportion_correct
from .simulated import Population, power, simulate_participants
from .stimuli import BASELINES, Stimuli, StimulusSettings, make_stimuli
from .study_report import report_markdown, write_report
from .trials import TASKS, participant_trials

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
