"""Names for array types that the stub of the core and the package share."""

import os
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Image: TypeAlias = NDArray[np.uint8]
Floats: TypeAlias = NDArray[np.float64]
Path: TypeAlias = str | os.PathLike[str]
