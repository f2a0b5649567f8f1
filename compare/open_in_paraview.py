"""Opens every file of a folder in ParaView, run by pvpython.

    pvpython compare/open_in_paraview.py FOLDER

Prints what ParaView found in each: points, cells, time steps, arrays. Ends with 1 when a file has no points, when an array
has another number of entries than there are points or cells, or when its values are not finite and are not said to be.
"""

import math
import sys
from pathlib import Path

from paraview.servermanager import Fetch
from paraview.simple import Delete, OpenDataFile

KINDS = {".vtu", ".vtk", ".vti", ".pvd", ".ply", ".obj", ".stl", ".csv"}
# Where there is no preimage, and outside of a solid, values are NaN.
MAY_BE_NAN = {"rgb", "images", "status"}


def problems(path):
    """What ParaView does not find in a file, and a line about what it finds."""
    source = OpenDataFile(str(path))
    if source is None:
        return ["no reader"], ""
    source.UpdatePipeline()
    times = list(getattr(source, "TimestepValues", None) or [])
    if times:
        source.UpdatePipeline(times[-1])
    information = source.GetDataInformation()
    points, cells, rows = (information.GetNumberOfPoints(), information.GetNumberOfCells(), information.GetNumberOfRows())
    found = []
    if points + rows == 0:
        found.append("nothing in it")
    if path.suffix != ".csv" and cells == 0:
        found.append("no cells")
    names = []
    for kind, data in (("point", source.PointData), ("cell", source.CellData)):
        for k in range(data.GetNumberOfArrays()):
            array = data.GetArray(k)
            names.append(f"{array.Name} ({kind}, {array.GetNumberOfComponents()})")
            ends = [end for c in range(array.GetNumberOfComponents()) for end in array.GetRange(c)]
            if not all(map(math.isfinite, ends)) and array.Name not in MAY_BE_NAN:
                found.append(f"{array.Name} is not finite")
    if path.suffix in (".vtu", ".vtk", ".vti"):
        found += mismatches(Fetch(source), points, cells)
    what = f"{points} points, {cells} cells" if not rows else f"{rows} rows"
    if times:
        what += f", {len(times)} time steps"
    Delete(source)
    return found, f"{what}; {', '.join(names) or 'no arrays'}"


def mismatches(data, points, cells):
    """Arrays whose length is not that of what they belong to, and cells of no kind."""
    found = []
    for count, arrays in ((points, data.GetPointData()), (cells, data.GetCellData())):
        for k in range(arrays.GetNumberOfArrays()):
            array = arrays.GetAbstractArray(k)
            if array.GetNumberOfTuples() != count:
                found.append(f"{array.GetName()} has {array.GetNumberOfTuples()} entries for {count}")
    if any(data.GetCellType(cell) == 0 for cell in range(cells)):
        found.append("cells of no kind")
    return found


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: pvpython open_in_paraview.py FOLDER")
    folder = Path(sys.argv[1]).resolve()
    paths = sorted(path for path in folder.rglob("*") if path.suffix in KINDS)
    failed = 0
    for path in paths:
        found, what = problems(path)
        failed += bool(found)
        print(f"{'FAILED ' if found else 'ok     '}{path.relative_to(folder)}: {'; '.join(found + [what])}")
    print(f"{len(paths) - failed} of {len(paths)} files opened")
    sys.exit(failed > 0 or not paths)


main()
