"""The steps of a farm: each from files in a folder of its own to files, by the functions that the verbs use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from geoerr.compensate.mark import name_of_model
from geoerr.compensate.program import CompensationResult, Writable, compensate_into
from geoerr.diagnose import Verdict
from geoerr.effects import load_catalogue, load_effects
from geoerr.errors import InputFileError
from geoerr.farm.folders import MODELS, TABLES, bytes_of, refuse_to_send
from geoerr.farm.outcome import NOTHING_CORRECTED, WARNING, StepResult
from geoerr.farm.place import Place
from geoerr.farm.placing import successor_of
from geoerr.farm.recipe import Recipe, Step
from geoerr.files import null_for_nan, write_json
from geoerr.machine import Machine, read_machine
from geoerr.measurements import Measurements, read_measurements
from geoerr.model import load_model, write_model

# The farm is what runs side by side.
_THREADS = 1
_OBSERVATIONS = "observations.csv"
# What stands before the names.
_VERDICTS: dict[Verdict, str] = {
    "missing": "missing: ",
    "ambiguous": "missing, or something that looks alike: ",
    "unknown": "missing: something without a name",
    "nothing-missing": "nothing missing",
}


class Bench:
    """A folder with copies of a machine's files, and what was read from them.

    Parameters
    ----------
    folder
        Where the copies are, and the results.
    recipe
        How steps are done.
    program
        What is to be corrected, by its name in the folder.
    session
        Pictures, where there are some to be measured.
    place
        Where the program stands and its result will, where it is no copy.
    """

    def __init__(
        self,
        folder: Path,
        recipe: Recipe,
        program: str | None = None,
        session: Path | None = None,
        place: Place | None = None,
    ) -> None:
        self.folder, self.recipe, self.program, self.session, self.place = folder, recipe, program, session, place

    def lay_out(self, files: Mapping[str, bytes]) -> None:
        """Write the copies."""
        for name, content in files.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)

    @cached_property
    def machine(self) -> Machine:
        """The machine."""
        return read_machine(self.folder / "machine.toml")

    @cached_property
    def measured(self) -> Measurements:
        """All its measurements."""
        tables = sorted(path for path in self.folder.iterdir() if path.suffix.lower() in TABLES)
        return read_measurements(tables, ranges_mm=self.machine.ranges_mm)

    @property
    def effect_files(self) -> list[Path]:
        """The file of the user's own effects, where there is one."""
        own = self.folder / "effects.toml"
        return [own] if own.is_file() else []

    @property
    def model(self) -> Path:
        """The best model that there is."""
        best = next((name for name in MODELS if (self.folder / name).is_file()), MODELS[0])
        return self.folder / best

    @cached_property
    def calibration(self) -> dict[str, Any]:
        """How the calibration moves the points, where cameras measured them."""
        rig, points = self.folder / "rig.json", self.measured.points
        if points is None or not rig.is_file() or "u_left" not in points.frame.columns:
            return {}
        from geoerr.vision.rig import read_rig
        from geoerr.vision.sensitivity import rig_sensitivity

        described = read_rig(rig)
        if described.covariance is None:
            return {}
        return {"rig_sensitivity": rig_sensitivity(described, points), "rig_covariance": described.covariance}

    def result(self, step: Step, says: str, *names: str, notes: tuple[str, ...] = ()) -> list[StepResult]:
        """Give a step's files and what is to be said of it."""
        files = bytes_of({name: self.folder / name for name in names})
        return [StepResult(step, self.program, files, says, notes=notes)]


def _measure(bench: Bench) -> list[StepResult]:
    """Measure a session's pictures, with its rig.json or a calibration of its own."""
    from geoerr.vision.calibrate import calibrate
    from geoerr.vision.measure import measure
    from geoerr.vision.measured import write_measured
    from geoerr.vision.rig import read_rig, write_rig
    from geoerr.vision.session import read_session

    assert bench.session is not None
    if not bench.session.is_dir():
        raise InputFileError(
            bench.session,
            "the worker cannot see this folder",
            remedy="measure on the computer that has the pictures, or share their disk",
        )
    session = read_session(bench.session)
    rig, written = bench.folder / "rig.json", [_OBSERVATIONS]
    if not rig.is_file():
        write_rig(rig, calibrate(session, threads=_THREADS).rig)
        written.append(rig.name)
    measured = measure(session, read_rig(rig), _THREADS)
    write_measured(bench.folder / _OBSERVATIONS, measured)
    says = f"{len(measured.observations)} observations from {measured.n_frames} frames, {len(measured.missed)} missed"
    return bench.result("measure", says, *written)


def _identify(bench: Bench) -> list[StepResult]:
    """Find the 21 errors; circles alone do not have them."""
    from geoerr.error_functions import write_errors
    from geoerr.identify.joint import identify_joint

    points = bench.measured.points
    if points is None:
        return []
    errors = identify_joint(points, bench.machine, threads=_THREADS, **bench.calibration).errors
    write_errors(bench.folder / "errors.json", errors)
    n_unknown = len(errors.not_determined)
    says = f"{len(errors.functions)} of 18 error functions, {len(errors.squareness)} of 3 squarenesses"
    return bench.result("identify", says + (f", {n_unknown} not determined" if n_unknown else ""), "errors.json")


def _fit(bench: Bench) -> list[StepResult]:
    from geoerr.fit import FitOptions, figures_document, fit_model

    recipe = bench.recipe
    result = fit_model(
        bench.machine,
        *bench.measured.tables,
        effects=recipe.effects,
        known=load_catalogue(bench.effect_files),
        options=FitOptions(components=recipe.components, threads=_THREADS),
        **bench.calibration,
    )
    write_model(bench.folder / "model.json", result.model)
    says = f"residual rms {figures_document(result.fitted)['rmse_um']:.1f} µm, {len(result.fitted.sightings)} rows"
    aside = len(bench.measured.set_aside)
    return bench.result("fit", says + (f", {aside} set aside" if aside else ""), "model.json")


def _diagnose(bench: Bench) -> list[StepResult]:
    from geoerr.diagnose.asked import diagnose
    from geoerr.diagnose.circles import diagnose_circles

    model, measured = load_model(bench.model), bench.measured
    own = [effect for path in bench.effect_files for effect in load_effects(path)]
    if measured.has_circles_only:
        found: Any = diagnose_circles(model, *measured.circles, effects=own, threads=_THREADS)
    else:
        found = diagnose(model, *measured.tables, effects=own, threads=_THREADS, **bench.calibration)
    write_json(bench.folder / "diagnosis.json", null_for_nan(found.to_document()))
    names = ", ".join(str(one.reference) for one in found.found)
    return bench.result("diagnose", _VERDICTS[found.verdict] + names, "diagnosis.json")


def _compensate(bench: Bench) -> list[StepResult]:
    """Correct the program: from file to file where it stands, else the copy."""
    assert bench.program is not None
    if bench.place is None:
        source = bench.folder / bench.program
        # Beside the copy, then in its place: what is handed back has the program's own name.
        corrected = source.with_name(f"{source.name}.corrected")
        with corrected.open("wb") as stream:
            done = _corrected(bench, source, stream)
        corrected.replace(source)
        refuse_to_send(source)
        return bench.result("compensate", _words(done), bench.program, notes=_notes(done))
    part = bench.place.new_part()
    with successor_of(Path(bench.place.result), part, bench.place.told_as) as successor:
        done = _corrected(bench, bench.place.source, successor)
    parts = {bench.program: part.name if successor.is_written else None}
    return [StepResult("compensate", bench.program, says=_words(done), notes=_notes(done), parts=parts)]


def _corrected(bench: Bench, source: Path, stream: Writable) -> CompensationResult:
    recipe, model = bench.recipe, load_model(bench.model)
    return compensate_into(
        model,
        source,
        stream,
        recipe.options,
        # What holds for all machines need not matter to each.
        at={name: value for name, value in recipe.at.items() if name in model.conditions},
        model_name=name_of_model(bench.model),
        threads=_THREADS,
    )


def _words(done: CompensationResult) -> str:
    if done.why_nothing_corrected:
        return NOTHING_CORRECTED
    return f"{done.moves_in} moves, largest correction {done.largest_correction_um:.1f} µm"


def _notes(done: CompensationResult) -> tuple[str, ...]:
    """Give what to know of a program, warnings first."""
    first = done.why_nothing_corrected or done.mostly_untouched
    extrapolated = [str(one) for one in done.extrapolated]
    return (
        *(f"{WARNING}{said}" for said in (*([first] if first else []), *done.warnings, *extrapolated)),
        *(said for said in done.notes if said not in extrapolated),
    )


DONE_BY: dict[Step, Callable[[Bench], list[StepResult]]] = {
    "measure": _measure,
    "identify": _identify,
    "fit": _fit,
    "diagnose": _diagnose,
    "compensate": _compensate,
}
