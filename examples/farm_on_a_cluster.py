"""Six printers on a cluster that loses a worker half-way: the results are those of one worker that does it all.

    python examples/farm_on_a_cluster.py [FOLDER]

On a cluster that there is, `Client("tcp://its-scheduler:8786")` takes the place of the two workers here. Any other
executor of the kind of `concurrent.futures` is given in the same way; without one all cores of this computer work.
Dask comes with `pip install '.[cluster]'`.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

try:
    from distributed import Client, LocalCluster
except ModuleNotFoundError:
    sys.exit("this example needs Dask: pip install '.[cluster]', in the folder that geoerr was installed from")
from virtual_machines import printers

import geoerr
from geoerr.farm import Farm

# Of the six.
HALF = 3


def main(folder: Path) -> None:
    """Do the farm twice, and compare."""
    printers(folder / "farm")

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        killed: list[int] = []

        def on_progress(done: int, total: int) -> None:
            if done >= HALF and not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)
                print(f"a worker is killed when {done} printers have a model")

        on_cluster = geoerr.run_farm(
            folder / "farm", folder / "cluster", executor=client.get_executor(), on_progress=on_progress
        )

    with ThreadPoolExecutor(1) as one_after_the_other:
        serial = geoerr.run_farm(folder / "farm", folder / "serial", executor=one_after_the_other)

    show(on_cluster)
    written, expected = contents(folder / "cluster"), contents(folder / "serial")
    same = written == expected and on_cluster == serial
    print(f"{len(written)} files, {'the same bytes' if same else 'DIFFERENT'} from the cluster and from one worker")
    if not same:
        sys.exit(1)


def show(farm: Farm) -> None:
    """Say what each printer lacks, and what failed."""
    for name, outcomes in farm.by_machine.items():
        said = {one.step: one.says for one in outcomes if one.error is None}
        print(f"{name}  {said.get('diagnose', 'failed')}")
    for one in farm.failures:
        print(f"failed: {one.step}: {one.error}")


def contents(folder: Path) -> dict[str, bytes]:
    """Give all files below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp()))
