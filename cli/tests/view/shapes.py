"""Surfaces and a block of hexahedra for the tests."""

import math


def ball(subdivisions):
    """Vertices on the unit sphere and triangles, by subdividing an octahedron."""
    vertices = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    triangles = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    for _ in range(subdivisions):
        middles = {}

        def middle(a, b):
            key = (min(a, b), max(a, b))
            if key not in middles:
                sums = [p + q for p, q in zip(vertices[a], vertices[b])]
                length = math.hypot(*sums)
                middles[key] = len(vertices)
                vertices.append(tuple(x / length for x in sums))
            return middles[key]

        finer = []
        for a, b, c in triangles:
            ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = finer
    return vertices, triangles


def ring(large, small, around, across):
    """Vertices and triangles of a torus about the z axis, facing outward."""
    vertices = []
    for j in range(across):
        for i in range(around):
            u, v = 2 * math.pi * i / around, 2 * math.pi * j / across
            distance = large + small * math.cos(v)
            vertices.append((distance * math.cos(u), distance * math.sin(u), small * math.sin(v)))
    triangles = []
    for j in range(across):
        for i in range(around):
            a, b = i + around * j, (i + 1) % around + around * j
            c, d = ((vertex + around) % (around * across) for vertex in (a, b))
            triangles += [(a, b, d), (a, d, c)]
    return vertices, triangles


def write_obj(path, vertices, triangles):
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    path.write_text("\n".join(lines) + "\n")


def code(light):
    """The sRGB code of a part of linear light, from 0 to 1."""
    return 12.92 * light if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055


def bent(point):
    """A deformation that folds nothing."""
    x, y, z = point
    return (2 * x + 0.4 * y * y, y - 0.5 * z, 0.8 * z + 0.3 * x * x)


def folded(point):
    """Turns back where x is less than -0.42."""
    x, y, z = point
    return (x + 1.2 * x * x, y, z)


def write_block(path, n):
    """Writes n × n × n hexahedra with cell data, as legacy VTK. One node is moved so far that cells around it are inverted.

    Cells have numbers, and the label 1 where x is less than one half, 5 elsewhere.
    """
    index = lambda i, j, k: i + (n + 1) * (j + (n + 1) * k)
    steps = range(n + 1)
    points = [(i / n, j / n, (k + 0.02 * (i * j) % 0.3) / n) for k in steps for j in steps for i in steps]
    middle = index(n // 2, n // 2, n // 2)
    points[middle] = tuple(x + 1.2 / n for x in points[middle])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = [
        [index(i + a, j + b, k + c) for a, b, c in corners]
        for k in range(n) for j in range(n) for i in range(n)
    ]
    lines = ["# vtk DataFile Version 3.0", "block", "ASCII", "DATASET UNSTRUCTURED_GRID"]
    lines += [f"POINTS {len(points)} double"] + [" ".join(map(repr, point)) for point in points]
    lines += [f"CELLS {len(cells)} {9 * len(cells)}"] + ["8 " + " ".join(map(str, cell)) for cell in cells]
    lines += [f"CELL_TYPES {len(cells)}"] + ["12"] * len(cells)
    lines += [f"CELL_DATA {len(cells)}", "SCALARS number double 1", "LOOKUP_TABLE default"]
    lines += [str(cell) for cell in range(len(cells))]
    lines += ["SCALARS part int 1", "LOOKUP_TABLE default"]
    lines += ["1" if cell % n < n / 2 else "5" for cell in range(len(cells))]
    path.write_text("\n".join(lines) + "\n")
