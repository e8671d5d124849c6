"""The rules of all rooms: measured constants, each section in or beside the file that reads it.

They are for measurements and may change in any version. Each can be varied or switched off alone by its name
(`tools/ablation.py`).
"""

from functools import cache
from importlib import import_module
from typing import TypeVar

from ..errors import ConfigError
from .section import Section

_Kind = TypeVar("_Kind", bound=Section)
# Sections by their names in a file. They are imported where a file is read or written only.
_PLACES = {
    "motion": "frontend.rules.MotionRules",
    "start": "frontend.second_motions.depth_order.StartRules",
    "repetition": "frontend.second_motions.repetition.RepetitionRules",
    "flow": "pictures.rules.FlowRules",
    "points": "frontend.new_points.PointRules",
    "templates": "frontend.templates.TemplateRules",
    "pair": "frontend.learnt.pair_check.PairRules",
    "turn": "frontend.learnt.usual_turns.TurnRules",
    "rows": "frontend.learnt.rows.RowRules",
    "errors": "frontend.rules.ErrorRules",
    "ghosts": "pictures.ghosts.GhostRules",
    "images": "pictures.rules.ImageRules",
    "mono": "frontend.mono.two_view.MonoRules",
    "inertia": "estimators.window.inertia.rules.InertiaRules",
    "robust": "geometry.robust_rules.RobustRules",
    "reported": "estimators.window.reported.rules.ReportedRules",
    "dense": "dense.rules.DenseRules",
}


class Rules(Section, frozen=True):
    """The sections of rules that a run has changed, in the order of a file."""

    changed: tuple[Section, ...] = ()

    def __post_init__(self) -> None:
        if not all(isinstance(section, Section) for section in self.changed):
            raise ConfigError(f"{self}: give sections of rules, as in Rules((TurnRules(),))")

    def of(self, kind: type[_Kind]) -> _Kind:
        """Return the section of this kind, with its defaults if it has not been changed."""
        for section in self.changed:
            if isinstance(section, kind):
                return section
        return _default(kind)


@cache
def _default(kind: type[_Kind]) -> _Kind:
    return kind()


@cache
def kinds_of_rules() -> dict[str, type[Section]]:
    """Return the kind of each section of rules, by its name in a file."""
    places = {name: place.rpartition(".") for name, place in _PLACES.items()}
    root = __package__.partition(".")[0]
    return {name: getattr(import_module(f"{root}.{file}"), kind) for name, (file, _, kind) in places.items()}
