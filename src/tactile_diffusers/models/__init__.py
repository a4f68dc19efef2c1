"""The models: one U-Net backbone, composed by LCTG and DALE."""

from .dale import DALEModel, DALEOutput
from .lctg import LCTGModel, LCTGOutput
from .rating_estimator import RatingEstimator
from .rating_statistics import RatingStatistics

__all__ = ["DALEModel", "DALEOutput", "LCTGModel", "LCTGOutput", "RatingEstimator", "RatingStatistics"]
