"""The whole job on a virtual machine: from pictures to a proven correction, every file left in one folder.

The steps are those of a user with a real machine and call what a user would call; only the first, the virtual machine
and its cameras, stands in for reality, and it shares no code with the rest.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import numpy.typing as npt

from geoerr.arguments import check_threads
from geoerr.compensate.mark import name_of_model
from geoerr.compensate.program import CompensationOptions, CompensationResult, compensate_program
from geoerr.error_functions import ErrorFunctions, write_errors
from geoerr.files import write_json
from geoerr.identify import NineLineResult, analyze_nine_lines
from geoerr.model import Model
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.plan import write_plan
from geoerr.simulate.session import simulate_session
from geoerr.simulate.truth import Truth
from geoerr.verify.ballbar import CircularTestResult, circle_to_test, run_circular_test
from geoerr.verify.path import PathResult, compare_paths
from geoerr.verify.workpiece import (
    WorkpieceResult,
    compare_workpieces,
    errors_of_points,
    li_pattern,
    predict_workpiece,
)
from geoerr.vision.calibrate import Calibration, calibrate
from geoerr.vision.measure import measure
from geoerr.vision.measured import Measured, write_measured
from geoerr.vision.rig import write_rig
from geoerr.vision.sensitivity import rig_sensitivity
from geoerr.vision.session import read_session

PROGRAM = "grid.gcode"
TOLERANCE_MM = 0.005

Advance = Callable[[int, int], None]
# Gives a context that shows a step with its title and hands out the function that advances it.
Stage = Callable[[str], AbstractContextManager[Advance]]


@dataclass(frozen=True)
class DemoResult:
    """Everything the demo found, for the summary and the report.

    Attributes
    ----------
    directory
        Folder of the files.
    truth
        What was put in.
    calibration, measured, identified
        What calibrate, measure and identify gave.
    compensation
        What rewriting the program did.
    path
        Path of the original and of the corrected program, carried out by the true machine.
    circle
        Li's circle, before and after, carried out by the true machine.
    workpiece
        Li's Table 4: relative positioning errors by group, before and after, on the true machine.
    """

    directory: Path
    truth: Truth
    calibration: Calibration
    measured: Measured
    identified: NineLineResult
    compensation: CompensationResult
    path: PathResult
    circle: CircularTestResult
    workpiece: WorkpieceResult

    @property
    def errors(self) -> ErrorFunctions:
        """The identified errors."""
        return self.identified.errors

    @property
    def model(self) -> Model:
        """The model that compensates."""
        return Model(self.errors.machine, self.errors)

    @property
    def true_machine(self) -> Model:
        """The machine that really moves."""
        return Model(self.truth.errors.machine, self.truth.errors)

    def error_after_mm(self, q_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Give what is left of the true machine's error at wanted positions (n, 3) when commands are compensated."""
        commands = self.model.commands_for(self.model.nominal_mm(q_mm))
        return self.true_machine.tool_from_work(commands) - self.true_machine.nominal_mm(q_mm)


def run_demo(directory: str | Path, stage: Stage, seed: int = 1, threads: int = 0) -> DemoResult:
    """Run every step; files of an earlier demo in the folder are replaced.

    Parameters
    ----------
    directory
        Made if absent: plan.toml, session/, rig.json, observations.csv, errors.json, the program, the corrected
        program and their figures.
    stage
        Shows a step.
    seed
        Of the machine's errors and of the pictures' noise.
    threads
        0 = all cores; never changes a result.

    Raises
    ------
    ShapeError
        for what is no number of threads.
    """
    # Before a folder is made.
    check_threads(threads)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    session_folder = folder / "session"
    with stage("simulating the machine and its cameras") as advance:
        plan = nine_line_plan(NineLines(seed=seed))
        write_plan(folder / "plan.toml", plan)
        truth = simulate_session(plan, session_folder, threads=threads, progress=advance)
    session = read_session(session_folder)
    with stage("calibrating both cameras") as advance:
        calibration = calibrate(session, threads=threads, progress=advance)
        write_rig(folder / "rig.json", calibration.rig)
    with stage("measuring the targets") as advance:
        measured = measure(session, calibration.rig, threads=threads, progress=advance)
        write_measured(folder / "observations.csv", measured)
    with stage("finding the 21 errors"):
        identified = analyze_nine_lines(
            measured.observations,
            truth.errors.machine,
            rig_sensitivity=rig_sensitivity(calibration.rig, measured.observations),
            rig_covariance=calibration.rig.covariance,
        )
        write_errors(folder / "errors.json", identified.errors)
    model = Model(identified.errors.machine, identified.errors)
    true_machine = Model(truth.errors.machine, truth.errors)
    with stage("correcting a program"):
        program, corrected = folder / PROGRAM, folder / f"{Path(PROGRAM).stem}-corrected.gcode"
        with resources.as_file(resources.files("geoerr.demo.programs") / PROGRAM) as source:
            shutil.copyfile(source, program)
        options = CompensationOptions(tolerance_mm=TOLERANCE_MM)
        compensation = compensate_program(
            model, program, corrected, options, model_name=name_of_model(folder / "errors.json"), threads=threads
        )
    with stage("proving the correction on the true machine"):
        path = compare_paths(true_machine, program, corrected)
        circle = run_circular_test(model, circle_to_test(model), truth=true_machine, with_eq23=True)
        pattern = li_pattern(model)
        before, after = (
            errors_of_points(predict_workpiece(model, pattern, compensated=compensated, truth=true_machine))
            for compensated in (False, True)
        )
        workpiece = compare_workpieces(before, after)
        for name, document in (
            ("verify-path.json", path.to_document()),
            ("verify-ballbar.json", circle.to_document()),
            ("verify-workpiece.json", workpiece.to_document()),
        ):
            write_json(folder / name, document)
    return DemoResult(folder, truth, calibration, measured, identified, compensation, path, circle, workpiece)
