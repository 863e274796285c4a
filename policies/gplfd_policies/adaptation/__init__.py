"""Adapting movements to via-points; for a skill, four forms with one interface.

Paper: Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979, Section III-D. "product" is the form of the paper, Eqs. (19)–(21).
"exact" conditions the same model without the product's approximation. "process" is
ours: it models the demonstrations' deviations as smooth, so that a via-point also
informs the rest of the motion. "similarity", for agents at doors, models that paths
differ in size. Other movements are conditioned by their own ``adapt``.
"""

from gplfd_policies.adaptation.forms import (
    ADAPTATIONS,
    AdaptedMovement,
    NoAdaptation,
    OwnAdaptation,
    adapt,
    begin_adaptation,
)
from gplfd_policies.adaptation.process import (
    ExactAdaptation,
    ForceAdaptation,
    ProcessAdaptation,
)
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.adaptation.similarity import SimilarityAdaptation
from gplfd_policies.movements.movement import Adaptation, AdaptationForm

__all__ = [
    "ADAPTATIONS",
    "Adaptation",
    "AdaptationForm",
    "AdaptedMovement",
    "ExactAdaptation",
    "ForceAdaptation",
    "NoAdaptation",
    "OwnAdaptation",
    "ProcessAdaptation",
    "ProductAdaptation",
    "SimilarityAdaptation",
    "adapt",
    "begin_adaptation",
]
