"""What the Rust core offers to the package; `geoerr.*` is the public face."""

from collections.abc import Sequence
from typing import Any, final

import numpy as np
import numpy.typing as npt

__version__: str
CHANNELS: tuple[str, ...]
BASE_COLUMNS: tuple[str, ...]
RIG_COLUMNS: tuple[str, ...]
CARRIERS: tuple[str, ...]

@final
class MachineModel:
    """A machine with its 21 errors; arrays are C-contiguous float64, offsets (1, 3) or (n, 3)."""

    def __new__(
        cls,
        chain: str,
        tool_offset_mm: tuple[float, float, float],
        squareness_rad: tuple[float, float, float],
        tables: list[tuple[str, npt.NDArray[np.float64], npt.NDArray[np.float64]]],
    ) -> MachineModel: ...
    @property
    def is_nominal(self) -> bool: ...
    def knots_mm(self, axis: int) -> npt.NDArray[np.float64]: ...
    def tool_from_work(
        self, q_mm: npt.NDArray[np.float64], offset_mm: npt.NDArray[np.float64], threads: int
    ) -> npt.NDArray[np.float64]: ...
    def error_mm(
        self, q_mm: npt.NDArray[np.float64], offset_mm: npt.NDArray[np.float64], threads: int
    ) -> npt.NDArray[np.float64]: ...
    def tool_from_base(
        self, q_mm: npt.NDArray[np.float64], offset_mm: npt.NDArray[np.float64], threads: int
    ) -> npt.NDArray[np.float64]: ...
    def work_from_base(
        self, q_mm: npt.NDArray[np.float64], offset_mm: npt.NDArray[np.float64], threads: int
    ) -> npt.NDArray[np.float64]: ...
    def jacobian(
        self, q_mm: npt.NDArray[np.float64], offset_mm: npt.NDArray[np.float64], threads: int
    ) -> npt.NDArray[np.float64]: ...
    def commands_for(
        self, target_mm: npt.NDArray[np.float64], tolerance_mm: float, threads: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.uint8]]: ...

@final
class TermMachine:
    """A machine of terms with parameters and conditions put in; methods as those of `MachineModel`.

    `motion` is (n, 10) or (1, 10): direction, travel (mm) and velocity (mm/s) of x y z, then the feed (mm/min); None
    is at rest, with directions unknown (0). It may go on with what the stroke before the last reversal left unwound
    of each of `windups` (index of the axis, length in mm), as a share of the lost motion; 0 else, as behind a long
    stroke. `long_stroke_terms` have others, which are always so.
    """

    def __new__(
        cls,
        model: VolumetricModel,
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        variables: Sequence[str],
        conditions: dict[str, float],
    ) -> TermMachine: ...
    @property
    def is_nominal(self) -> bool: ...
    @property
    def motion_names(self) -> list[str]: ...
    @property
    def windups(self) -> list[tuple[int, float]]: ...
    @property
    def long_stroke_terms(self) -> list[int]: ...
    @property
    def rig_terms(self) -> list[int]: ...
    def knots_mm(self, axis: int) -> npt.NDArray[np.float64]: ...
    def tool_from_work(
        self,
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        threads: int,
        motion: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.float64]: ...
    def error_mm(
        self,
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        threads: int,
        motion: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.float64]: ...
    def tool_from_base(
        self,
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        threads: int,
        motion: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.float64]: ...
    def work_from_base(
        self,
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        threads: int,
        motion: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.float64]: ...
    def jacobian(
        self,
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        threads: int,
        motion: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.float64]: ...
    def commands_for(
        self,
        target_mm: npt.NDArray[np.float64],
        tolerance_mm: float,
        threads: int,
        motion: npt.NDArray[np.float64] | None = None,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.uint8]]: ...

def channel_columns(
    chain: str,
    carriers: npt.NDArray[np.uint8],
    q_mm: npt.NDArray[np.float64],
    offset_mm: npt.NDArray[np.float64],
    tool_offset_mm: tuple[float, float, float],
    threads: int,
) -> npt.NDArray[np.float64]: ...
def chain_positions(
    chain: str,
    what: str,
    carriers: npt.NDArray[np.uint8],
    q_mm: npt.NDArray[np.float64],
    offset_mm: npt.NDArray[np.float64],
    tool_offset_mm: tuple[float, float, float],
    channels: npt.NDArray[np.float64],
    threads: int,
) -> npt.NDArray[np.float64]: ...
def rig_columns(
    camera_from_base: npt.NDArray[np.float64],
    t_mm: tuple[float, float, float],
    base_mm: npt.NDArray[np.float64],
    threads: int,
) -> npt.NDArray[np.float64]: ...
def measured_from_base(
    camera_from_base: npt.NDArray[np.float64],
    t_mm: tuple[float, float, float],
    rig: npt.NDArray[np.float64],
    base_mm: npt.NDArray[np.float64],
    threads: int,
) -> npt.NDArray[np.float64]: ...

@final
class Basis:
    """Functions of one axis position; positions and coefficients are C-contiguous float64 (n,), rows (n, len)."""

    @staticmethod
    def bspline(knots_mm: npt.NDArray[np.float64], degree: int) -> Basis: ...
    @staticmethod
    def polynomial(low_mm: float, high_mm: float, degree: int) -> Basis: ...
    @staticmethod
    def fourier(low_mm: float, high_mm: float, period_mm: float, order: int) -> Basis: ...
    @staticmethod
    def linear_elements(nodes_mm: npt.NDArray[np.float64]) -> Basis: ...
    @staticmethod
    def quadratic_elements(nodes_mm: npt.NDArray[np.float64]) -> Basis: ...
    @staticmethod
    def tangent_integral(of: Basis) -> Basis: ...
    def __len__(self) -> int: ...
    @property
    def range(self) -> tuple[float, float]: ...
    def kinks(self) -> npt.NDArray[np.float64]: ...
    def evaluate(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def derivative(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def integral(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def value_row(self, q_mm: float) -> npt.NDArray[np.float64]: ...
    def mean_row(self) -> npt.NDArray[np.float64]: ...
    def slope_row(self) -> npt.NDArray[np.float64]: ...
    def curve(self, coefficients: npt.NDArray[np.float64]) -> Curve: ...

@final
class Curve:
    """A basis with its coefficients; positions are C-contiguous float64 (n,)."""

    @staticmethod
    def constant(value: float) -> Curve: ...
    def plus(self, other: Curve) -> Curve: ...
    def evaluate(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def derivative(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def kinks(self) -> npt.NDArray[np.float64]: ...

@final
class Hexahedra:
    """Eight-node elements on a grid; points are C-contiguous float64 (n, 3), rows (n, len)."""

    def __new__(
        cls, x_mm: npt.NDArray[np.float64], y_mm: npt.NDArray[np.float64], z_mm: npt.NDArray[np.float64]
    ) -> Hexahedra: ...
    def __len__(self) -> int: ...
    def evaluate(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...

@final
class CandidateScene:
    """What a fit leaves, as the core judges candidates against it.

    Parameters
    ----------
    basis : (n, 3, n_basis)
        What the model is free to do, whitened and orthonormal.
    residual : (n, 3)
        What it leaves, whitened.
    draws : (n, 3, n_draws) or None
        Draws of noise off the basis: products are in single precision, as they are. None: in double precision.
    directions : (n_channels, 3, n)
        Whitened displacement of each row by one unit on each channel.
    noise
        What whitens the noise.
    """

    def __new__(
        cls,
        basis: npt.NDArray[np.float64],
        residual: npt.NDArray[np.float64],
        draws: npt.NDArray[np.float32] | None,
        directions: npt.NDArray[np.float64],
        noise: NoiseWhitening,
        threads: int,
    ) -> CandidateScene: ...
    def scan(
        self,
        variables: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t: npt.NDArray[np.float64] | None,
        expressions: list[tuple[Expression, bool]],
        formulas: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]],
        series: npt.NDArray[np.float64],
        given: npt.NDArray[np.float64],
        products: list[tuple[int, int]],
        groups: list[
            tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64], npt.NDArray[np.int64], int]
        ],
        threads: int,
    ) -> list[
        tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64], npt.NDArray[np.float64]]
    ]:
        """Judge groups of columns at all their trials: gain, rank, share, and by rank the largest of draws.

        `expressions`: each with whether it is proportional to the last of its variables, which is the series that it
        follows. `formulas`: the number of each one's expression, of its series (−1: none), where its inner values
        begin, and those.
        """
        ...

@final
class Expression:
    """A parsed formula; `columns` is (k, n): one row for each of `variables`, C-contiguous float64.

    `starts` are the first rows of sequences (empty: one sequence), `t` the times in s (None: the number of the row).
    """

    def __new__(
        cls,
        text: str,
        variables: Sequence[str],
        coefficients: Sequence[str],
        inner: Sequence[str],
        definitions: dict[str, str],
    ) -> Expression: ...
    @property
    def text(self) -> str: ...
    @property
    def variables_used(self) -> list[str]: ...
    @property
    def coefficients_used(self) -> list[str]: ...
    @property
    def needs_order(self) -> bool: ...
    def evaluate(
        self,
        columns: npt.NDArray[np.float64],
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t: npt.NDArray[np.float64] | None,
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def coefficient_columns(
        self,
        columns: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t: npt.NDArray[np.float64] | None,
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def inner_derivatives(
        self,
        columns: npt.NDArray[np.float64],
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t: npt.NDArray[np.float64] | None,
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def position_derivatives(
        self,
        columns: npt.NDArray[np.float64],
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t: npt.NDArray[np.float64] | None,
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def evaluate_at(
        self,
        point: npt.NDArray[np.float64],
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
    ) -> tuple[float, npt.NDArray[np.float64]]: ...

def history(
    q_mm: npt.NDArray[np.float64],
    t_s: npt.NDArray[np.float64] | None,
    moving: npt.NDArray[np.float64] | None,
    feed_mm_min: npt.NDArray[np.float64] | None,
    direction: npt.NDArray[np.float64] | None,
    starts: npt.NDArray[np.int64],
    curve: npt.NDArray[np.float64] | None = None,
) -> dict[str, npt.NDArray[np.float64]]: ...
def triangulate(
    projection_left: npt.NDArray[np.float64],
    projection_right: npt.NDArray[np.float64],
    uv_left_px: npt.NDArray[np.float64],
    uv_right_px: npt.NDArray[np.float64],
    cov_left_px2: npt.NDArray[np.float64] | None,
    cov_right_px2: npt.NDArray[np.float64] | None,
    sigma_px: float,
    reweightings: int,
    threads: int,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.uint8]]: ...
def triangulate_points(
    projection_left: npt.NDArray[np.float64],
    projection_right: npt.NDArray[np.float64],
    uv_left_px: npt.NDArray[np.float64] | npt.NDArray[np.float32],
    uv_right_px: npt.NDArray[np.float64] | npt.NDArray[np.float32],
    threads: int,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint8]]: ...
def fit_lines(
    points_mm: npt.NDArray[np.float64],
    starts: npt.NDArray[np.int64],
    covariance_mm2: npt.NDArray[np.float64] | None,
    along: bool,
    direction_covariance: bool,
    threads: int,
) -> tuple[
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.uint8],
]: ...
def integrate_straightness(
    position_mm: npt.NDArray[np.float64], values: npt.NDArray[np.float64], rule: str, threads: int
) -> npt.NDArray[np.float64]: ...
def remove_line(
    position_mm: npt.NDArray[np.float64], values: npt.NDArray[np.float64], threads: int
) -> npt.NDArray[np.float64]: ...

@final
class NoiseBlocks:
    """Blocks of rows, sorted by session and time (`geoerr.fit.noise_model.Blocks`).

    Parameters
    ----------
    block : (n,)
        Block of each row.
    session_starts
        First block of each session.
    pass_number, time : (n_blocks,)
        Times in units of the session's span.
    """

    def __new__(
        cls,
        block: npt.NDArray[np.int64],
        session_starts: npt.NDArray[np.int64],
        pass_number: npt.NDArray[np.int64],
        time: npt.NDArray[np.float64],
    ) -> NoiseBlocks: ...
    def likelihood(
        self,
        weights: npt.NDArray[np.float64],
        residual: npt.NDArray[np.float64],
        basis: npt.NDArray[np.float64],
        threads: int,
    ) -> NoiseLikelihood: ...
    def whitening(self, weights: npt.NDArray[np.float64], logs: npt.NDArray[np.float64]) -> NoiseWhitening: ...
    def take_off(
        self,
        drawn: npt.NDArray[np.float32],
        basis: npt.NDArray[np.float64],
        weights: npt.NDArray[np.float64],
        logs: npt.NDArray[np.float64],
        shortest_memory: float,
        size: float,
        threads: int,
    ) -> None: ...

@final
class NoiseWhitening:
    """What whitens noise: V^(-1/2), its transpose and its inverse, of values (n, 3, m)."""

    def whiten(self, values: npt.NDArray[np.float64], threads: int) -> npt.NDArray[np.float64]: ...
    def whiten_transposed(self, values: npt.NDArray[np.float64], threads: int) -> npt.NDArray[np.float64]: ...
    def unwhiten(self, values: npt.NDArray[np.float64], threads: int) -> npt.NDArray[np.float64]: ...

@final
class NoiseLikelihood:
    """−2 ln L of the noise of residuals; `logs` (3, 4) is ln σ², ln a², ln b², ln τ of each component.

    Arrays that are asked for again are those that it was made of: it holds their sums.
    """

    @property
    def is_used(self) -> list[bool]: ...
    def minus_twice_ln(
        self, logs: npt.NDArray[np.float64], restricted: bool, threads: int
    ) -> tuple[float, npt.NDArray[np.float64]]: ...
    def fit(
        self, start: npt.NDArray[np.float64] | None, shortest_memory: float, restricted: bool, threads: int
    ) -> tuple[npt.NDArray[np.float64], float, int]: ...
    def with_columns(
        self,
        weights: npt.NDArray[np.float64],
        residual: npt.NDArray[np.float64],
        basis: npt.NDArray[np.float64],
        columns: npt.NDArray[np.float64],
        threads: int,
    ) -> NoiseLikelihood: ...
    def whitened_basis(
        self,
        weights: npt.NDArray[np.float64],
        basis: npt.NDArray[np.float64],
        logs: npt.NDArray[np.float64],
        threads: int,
    ) -> npt.NDArray[np.float64] | None: ...

@final
class GcodeRewriter:
    """A program on its way through the core: push its bytes, pull the corrected ones."""

    def __new__(
        cls,
        model: MachineModel | TermMachine,
        *,
        work_offset_mm: tuple[float, float, float] | None,
        tolerance_mm: float,
        digits: int,
        home_mm: tuple[float, float, float] | None,
        firmware: str | None,
        passes_unsupported: bool,
        holds_outside_measured: bool,
        firmware_corrections_named: bool,
        still: list[str],
        range_mm: list[tuple[float, float]],
        measured_mm: list[tuple[float, float]],
        model_name: str,
    ) -> GcodeRewriter: ...
    def push(self, program: bytes, is_last: bool) -> None: ...
    def pull(self, threads: int) -> bytes | None: ...
    def summary(self) -> dict[str, Any]: ...
    def extremes(self) -> tuple[list[float], list[float]]: ...
    def movers(self) -> tuple[list[tuple[str, int]], int]: ...
    def warnings(self) -> list[tuple[str, int, str, int, str]]: ...

def unclear_extrusion(*, is_lost: bool) -> tuple[str, str]:
    """Give what is said of a split move of which firmwares differ on what it extrudes, and the remedy."""

_Shape = Basis | Expression
_Part = tuple[str, float, int, _Shape, list[int], list[int]]
_Frames = tuple[
    npt.NDArray[np.uint8],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
]

@final
class VolumetricModel:
    """A machine whose errors are a sum of terms; arrays are C-contiguous, carriers 0 to 3, variables (k, n)."""

    def __new__(
        cls, chain: str, tool_offset_mm: tuple[float, float, float], terms: list[tuple[int, int, list[_Part]]]
    ) -> VolumetricModel: ...
    @property
    def n_coefficients(self) -> int: ...
    @property
    def n_inner(self) -> int: ...
    def displacements(
        self,
        carriers: npt.NDArray[np.uint8],
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        variables: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t_s: npt.NDArray[np.float64] | None,
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def channel_values(
        self,
        carriers: npt.NDArray[np.uint8],
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        variables: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t_s: npt.NDArray[np.float64] | None,
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def columns(
        self,
        carriers: npt.NDArray[np.uint8],
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        variables: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t_s: npt.NDArray[np.float64] | None,
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        threads: int,
    ) -> npt.NDArray[np.float64]: ...

@final
class FitState:
    """All unknowns of a problem."""

    @property
    def coefficients(self) -> npt.NDArray[np.float64]: ...
    @property
    def inner(self) -> npt.NDArray[np.float64]: ...
    @property
    def shared(self) -> npt.NDArray[np.float64]: ...
    @property
    def rotations(self) -> npt.NDArray[np.float64]: ...
    @property
    def translations_mm(self) -> npt.NDArray[np.float64]: ...
    @property
    def excess_mm(self) -> npt.NDArray[np.float64]: ...
    def in_frames_of(self, other: FitState) -> FitState: ...

@final
class FitSolution:
    """A solution, and what of it the data determine."""

    @property
    def rank(self) -> int: ...
    @property
    def rank_gap(self) -> float: ...
    @property
    def condition(self) -> float: ...
    @property
    def is_determined(self) -> list[bool]: ...
    @property
    def null_space(self) -> npt.NDArray[np.float64]: ...
    @property
    def covariance_root(self) -> npt.NDArray[np.float64]: ...
    @property
    def spread(self) -> npt.NDArray[np.float64]: ...
    def covariance_root_of_first(self, count: int) -> npt.NDArray[np.float64]: ...
    def step(self, gradient: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...

@final
class FitTriangle:
    """What a whitened design leaves behind."""

    def solve(self, further: npt.NDArray[np.float64] | None, threads: int) -> FitSolution: ...

@final
class FitSums:
    """What blocks of rows of a design sum up to."""

@final
class FitProblem:
    """A model and what was measured of it; columns: coefficients, free inner parameters, frames, shared unknowns."""

    def __new__(
        cls,
        model: VolumetricModel,
        carriers: npt.NDArray[np.uint8],
        q_mm: npt.NDArray[np.float64],
        offset_mm: npt.NDArray[np.float64],
        variables: npt.NDArray[np.float64],
        starts: npt.NDArray[np.int64],
        t_s: npt.NDArray[np.float64] | None,
        measured_mm: npt.NDArray[np.float64],
        whitening: npt.NDArray[np.float64],
        session: npt.NDArray[np.int64],
        frames: _Frames,
        coefficients: npt.NDArray[np.float64],
        inner: npt.NDArray[np.float64],
        free_inner: list[int],
        shared: npt.NDArray[np.float64] | None,
        beside: FitProblem | None = None,
        length: npt.NDArray[np.int64] | None = None,
    ) -> FitProblem: ...
    @property
    def n_columns(self) -> int: ...
    @property
    def first_shared_column(self) -> int: ...
    @property
    def start(self) -> FitState: ...
    def residuals(self, state: FitState, threads: int) -> npt.NDArray[np.float64]: ...
    def whitened(self, residuals_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def in_base_axes(self, state: FitState, vectors_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def corrected(self, state: FitState, correction: npt.NDArray[np.float64]) -> FitState: ...
    def triangle(
        self,
        state: FitState,
        row_scale: npt.NDArray[np.float64],
        constraints: npt.NDArray[np.float64],
        prior: npt.NDArray[np.float64] | None,
        threads: int,
        known: tuple[FitTriangle, npt.NDArray[np.int64]] | None = None,
    ) -> FitTriangle: ...
    def gradient(
        self,
        state: FitState,
        residuals_mm: npt.NDArray[np.float64],
        row_scale: npt.NDArray[np.float64],
        threads: int,
    ) -> npt.NDArray[np.float64]: ...
    def times(
        self,
        state: FitState,
        matrix: npt.NDArray[np.float64],
        row_scale: npt.NDArray[np.float64],
        threads: int,
        rows: npt.NDArray[np.int64] | None = None,
    ) -> npt.NDArray[np.float64]: ...
    def first_order_mm(
        self, state: FitState, correction: npt.NDArray[np.float64], threads: int
    ) -> npt.NDArray[np.float64]: ...
    def largest_entries(
        self, state: FitState, columns: npt.NDArray[np.int64], threads: int
    ) -> tuple[npt.NDArray[np.float64] | None, tuple[int, int] | None]: ...
    def leave_out(
        self,
        state: FitState,
        solution: FitSolution,
        residuals_mm: npt.NDArray[np.float64],
        order: npt.NDArray[np.int64],
        starts: npt.NDArray[np.int64],
        own: npt.NDArray[np.int64],
        weights: npt.NDArray[np.float64],
        threads: int,
        known: tuple[FitSums, npt.NDArray[np.int64]] | None = None,
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], list[bool], FitSums | None]: ...
    def design(
        self, state: FitState, row_scale: npt.NDArray[np.float64], first: int, last: int, threads: int
    ) -> npt.NDArray[np.float64]: ...

@final
class LeastSquares:
    """A solved system of n unknowns and k right-hand sides; not determined is NaN in errors and covariance."""

    @property
    def x(self) -> npt.NDArray[np.float64]: ...
    @property
    def residual_ss(self) -> npt.NDArray[np.float64]: ...
    @property
    def degrees_of_freedom(self) -> int: ...
    @property
    def n_free(self) -> int: ...
    @property
    def rank(self) -> int: ...
    @property
    def rank_tolerance(self) -> float: ...
    @property
    def rank_gap(self) -> float: ...
    @property
    def condition(self) -> float: ...
    @property
    def singular_values(self) -> npt.NDArray[np.float64] | None: ...
    @property
    def is_determined(self) -> npt.NDArray[np.bool_]: ...
    @property
    def null_space(self) -> npt.NDArray[np.float64]: ...
    @property
    def is_from_normal_equations(self) -> bool: ...
    def covariance(self) -> npt.NDArray[np.float64]: ...
    def standard_errors(self) -> npt.NDArray[np.float64]: ...
    def is_estimable(self, c: npt.NDArray[np.float64]) -> bool: ...
    def functional(self, c: npt.NDArray[np.float64], rhs: int) -> tuple[float, float] | None: ...
    def growth_without(self, functionals: npt.NDArray[np.float64], rhs: int) -> float | None: ...
    def solve_normal(self, atr: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]: ...
    def leave_blocks_out(
        self,
        a: npt.NDArray[np.float64],
        b: npt.NDArray[np.float64],
        starts: list[int],
        rhs: int,
        threads: int,
    ) -> tuple[
        npt.NDArray[np.float64],
        npt.NDArray[np.float64],
        npt.NDArray[np.bool_],
    ]: ...

def solve_least_squares(
    a: npt.NDArray[np.float64],
    b: npt.NDArray[np.float64],
    *,
    constraints: npt.NDArray[np.float64] | None,
    basis: npt.NDArray[np.float64] | None,
    rank_tolerance: float | None,
    wants_singular_values: bool,
    method: str,
    threads: int,
) -> LeastSquares: ...
def orthonormal_columns(a: npt.NDArray[np.float64], threads: int) -> npt.NDArray[np.float64]: ...
def products_of_columns(
    a: npt.NDArray[np.float64], b: npt.NDArray[np.float64], threads: int
) -> npt.NDArray[np.float64]: ...
def fit_marker(
    picture: npt.NDArray[np.uint8],
    focal_px: tuple[float, float],
    principal_point_px: tuple[float, float],
    distortion: npt.NDArray[np.float64],
    pattern: npt.NDArray[np.bool_],
    corners_px: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], float, float, npt.NDArray[np.float64], float, float]:
    """Corners (4, 2), their covariance (8, 8), noise, contrast, blur (2,), misfit, unevenness of one picture."""
