"""Reports: small classes with the fields that the program prints with ``--json`` (``docs/json.md`` explains each)."""

from __future__ import annotations

import copy
import json
import sys
from typing import Any, ClassVar, Dict, List, Optional, Type, TypeVar

from ._text import Rows, percent, significant, table, two_columns

R = TypeVar("R", bound="Report")


class Report:
    """What a call found.

    Fields are attributes; those that do not apply are ``None``, as are numbers that are infinite or not a number. The
    text of a report reads like the program's summary.
    """

    _classes: ClassVar[Dict[type, Dict[str, Type["Report"]]]] = {}

    def __init__(self, data: Dict[str, Any]) -> None:
        self._data = data
        nested = self._nested()
        for name in self._names():
            setattr(self, name, None)
        for name, value in data.items():
            kind = nested.get(name)
            if kind is not None and isinstance(value, dict):
                value = kind(value)
            elif kind is not None and isinstance(value, list):
                value = [kind(each) if isinstance(each, dict) else each for each in value]
            setattr(self, name, value)

    @classmethod
    def _names(cls) -> List[str]:
        found: List[str] = []
        for parent in reversed(cls.__mro__):
            found.extend(name for name in parent.__dict__.get("__annotations__", {}) if not name.startswith("_"))
        return found

    @classmethod
    def _nested(cls) -> Dict[str, Type["Report"]]:
        """The classes of fields that are reports themselves, or lists of them."""
        if cls not in Report._classes:
            found: Dict[str, Type[Report]] = {}
            for parent in cls.__mro__:
                for name, annotation in parent.__dict__.get("__annotations__", {}).items():
                    text = annotation if isinstance(annotation, str) else str(annotation)
                    for word in text.replace("[", " ").replace("]", " ").split():
                        kind = getattr(sys.modules[parent.__module__], word, None)
                        if isinstance(kind, type) and issubclass(kind, Report):
                            found[name] = kind
            Report._classes[cls] = found
        return Report._classes[cls]

    @classmethod
    def _read(cls: Type[R], text: str) -> R:
        return cls(json.loads(text))

    def as_dict(self) -> Dict[str, Any]:
        """The report as dictionaries, lists, numbers and text."""
        return copy.deepcopy(self._data)

    def _rows(self) -> Rows:
        """The lines of the summary: all plain fields, if a class has no other."""
        rows = []
        for name, value in self._data.items():
            if isinstance(value, dict):
                parts = [f"{key} {significant(each)}" for key, each in value.items() if not isinstance(each, (dict, list))]
                value = "   ".join(parts)
            elif isinstance(value, list):
                value = f"{len(value)} entries" if len(value) > 8 else ", ".join(significant(each) for each in value)
            rows.append((name, significant(value, 4)))
        return rows

    def __repr__(self) -> str:
        return two_columns(self._rows())

    def _repr_html_(self) -> str:
        return table(type(self).__name__, self._rows())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and type(other) is type(self) and self._data == other._data

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> Any:
        return type(self), (self._data,)


class WorstPlace(Report):
    """A connected group of cells or triangles where a map is worst."""

    kind: str
    count: int
    point: List[float]
    centre: List[float]
    low: List[float]
    high: List[float]
    measure: float
    share: float
    value: Optional[float]


class Finding(Report):
    """A defect."""

    kind: str
    severity: str
    count: int
    vertices: List[int]
    message: str
    advice: str

    def _rows(self) -> Rows:
        return [(self.severity, self.message), ("repair", self.advice)]


class _Text(Report):
    """A report whose text the library writes."""

    _text: str

    def __init__(self, data: Dict[str, Any], text: str = "") -> None:
        super().__init__(data)
        self._text = text

    def __repr__(self) -> str:
        return self._text.rstrip("\n")

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(repr(self))}</pre>"

    def __reduce__(self) -> Any:
        return type(self), (self._data, self._text)


class CheckReport(_Text):
    """What is wrong with a surface, where, and how to repair it."""

    vertices: int
    faces: int
    closed: bool
    edge_manifold: bool
    vertex_manifold: bool
    consistently_oriented: bool
    outward: bool
    self_intersections: Dict[str, Any]
    area: float
    volume: Optional[float]
    bounding_box: Optional[List[List[float]]]
    diagonal: float
    components: List[Dict[str, Any]]
    findings: List[Finding]
    cells: Optional[CellReport]

    @property
    def solvable(self) -> bool:
        """Whether the surface bounds a solid, once its triangles face outward."""
        return not any(finding.severity == "error" for finding in self.findings)

    @property
    def genus(self) -> Optional[int]:
        """The number of handles, where the surface is one closed manifold."""
        return self.components[0]["genus"] if len(self.components) == 1 else None


class CellReport(_Text):
    """What is wrong with the cells of a mesh."""

    kind: str
    vertices: int
    inverted_cells: int
    flat_cells: int
    slivers: int
    min_scaled_jacobian: Optional[float]
    mean_scaled_jacobian: Optional[float]
    bodies: List[Dict[str, Any]]
    findings: List[Finding]
    cells: int

    @property
    def valid(self) -> bool:
        """Whether all cells are usable and fit together."""
        return not any(finding.severity == "error" for finding in self.findings)


class BoundaryError(Report):
    """Distances from the boundary map at points that the fit has not seen, over the target's diagonal."""

    rms: float
    p99: float
    max: float


class LocalError(Report):
    """The same over the spacing of the image's vertices around."""

    p99: float
    max: float


class FreeSourcesReport(Report):
    """What became of free sources."""

    rounds: int
    end: str
    residual_before: float
    residual_after: float
    boundary_error_before: BoundaryError
    kept: bool


class FitReport(Report):
    """What a fit did, and how well it meets its boundary map."""

    vertices: int
    faces: int
    sources: int
    collocation: int
    method: str
    placement: Dict[str, Any]
    affine: bool
    iterations: int
    refinements: int
    refinement_end: Optional[str]
    free_sources: Optional[FreeSourcesReport]
    stop: Optional[str]
    rank: Optional[int]
    condition: Optional[float]
    boundary_error: BoundaryError
    local_error: Optional[LocalError]
    c_error: float
    residual_rms: float
    memory_estimate: int
    seconds: Optional[Dict[str, float]]
    warnings: List[str]

    _ENDS = {
        "tolerance": "the tolerance is met",
        "off": "not asked for",
        "fixed": "this method does not refine",
        "max_sources": "ended by max_sources",
        "max_source_ratio": "ended by max_s_ratio",
        "memory": "ended by memory",
        "in_vain": "more sources did not help",
        "no_room": "no room for more sources",
        "concluded": "ended by time_limit",
    }

    def _rows(self) -> Rows:
        error = self.boundary_error
        rounds = {0: "none", 1: "1 round"}.get(self.refinements, f"{self.refinements} rounds")
        end = self._ENDS.get(self.refinement_end or "")
        rows = [
            ("boundary", f"{self.vertices} vertices, {self.faces} triangles"),
            ("system", f"{self.sources} sources, {self.collocation} collocation points"),
            ("solver", f"{self.method}, stopped after {self.iterations} iterations"),
            ("refinement", f"{rounds}, {end}" if end else rounds),
            ("boundary error", f"rms {error.rms:.2e}   99 % {error.p99:.2e}   max {error.max:.2e}"),
            ("", "at held-out points, as fractions of the target's diagonal"),
            ("residual", f"rms {self.residual_rms:.2e} at the collocation points (C-Error {self.c_error:.2e})"),
        ]
        if self.rank is not None:
            condition = "singular" if self.condition is None else f"{self.condition:.1e}"
            rows[2] = ("solver", f"{self.method}, rank {self.rank}, condition {condition}")
        if self.free_sources is not None:
            moved = self.free_sources
            text = f"{moved.rounds} rounds, residual {moved.residual_before:.2e} to {moved.residual_after:.2e}"
            rows.append(("free sources", text if moved.kept else f"{text}; not used, since the boundary error rose"))
        if self.seconds:
            total, factor = self.seconds["total"], self.seconds["factor"]
            rows.append(("time", f"{total:.2f} s, of which factoring {factor:.2f} s"))
        rows.extend(("warning", warning) for warning in self.warnings)
        return rows


class SphereReport(Report):
    """How a surface was mapped to the sphere."""

    energy: str
    start: str
    energy_before: float
    energy_after: float
    iterations: int
    converged: bool
    concluded: bool
    vertices: int
    faces: int
    certificate: Dict[str, Any]
    distortion: Optional[Dict[str, Any]]

    def _rows(self) -> Rows:
        flipped, degree = self.certificate["flipped"], self.certificate["degree"]
        return [
            ("surface", f"{self.vertices} vertices, {self.faces} triangles"),
            ("one to one", f"yes, decided exactly: {flipped} flipped triangles, degree {degree:.6f}"),
            ("preserved", {"balanced": "angles, with the distortion of areas bounded"}.get(self.energy, "angles")),
            (
                "energy",
                f"{self.energy_before:.4f} before, {self.energy_after:.4f} after {self.iterations} iterations of "
                "Newton's method",
            ),
        ]


class ImproveReport(Report):
    """How a boundary map was improved."""

    energies: List[float]
    rounds: int
    end: str
    before: Dict[str, Any]
    after: Dict[str, Any]
    distortions: List[float]
    boundary_errors: List[float]
    warnings: List[str]

    def _rows(self) -> Rows:
        first, last = self.energies[0], self.energies[-1]
        before, after = self.distortions
        return [
            ("harmonic energy", f"{first:.5g} before, {last:.5g} after ({100 * (last / first - 1):.2g} %)"),
            ("surface", f"symmetric Dirichlet energy at 99.9 % of the area {before:.3g} before, {after:.3g} after"),
            ("rounds", f"{self.rounds}, {len(self.energies) - 1} of which lowered the energy"),
        ]


class PairReport(Report):
    """How the boundary map of a pair was made."""

    via: str
    landmarks: int
    landmark_error: float
    coarse_embeddings: int
    starts: List[Dict[str, Any]]
    start: int
    alternatives: List[Dict[str, Any]]
    rotations: List[float]
    schedule: Optional[Dict[str, Any]]
    torus: Optional[Dict[str, Any]]
    #: The torus that :func:`solidmap.boundary.torus` maps to.
    fitting_torus: Optional[Dict[str, Any]] = None
    hyperbolic: Optional[Dict[str, Any]]
    before: Dict[str, Any]
    after: Dict[str, Any]
    isometry_defect: Optional[float]
    nearer_isometry: Optional[Dict[str, Any]]
    is_reversed: bool
    stretch: Dict[str, Any]
    shells: List[Dict[str, Any]]
    seconds: Dict[str, float]
    concluded: bool
    warnings: List[str]
    looks_wrong: bool

    def _rows(self) -> Rows:
        stretch = self.stretch
        surface = "torus" if self.torus else "hyperbolic surface" if self.hyperbolic else "sphere"
        decided = "" if self.hyperbolic else ", decided exactly"
        if self.shells:
            surface = "sphere, torus or hyperbolic surface"
        rows = [
            ("map", f"one to one: no triangle flipped on the {surface}, degree 1{decided}"),
            ("coarse", f"the best of {self.coarse_embeddings} coarse embeddings"),
        ]
        for index, shell in enumerate(self.shells):
            kind = "cavity" if shell["is_cavity"] else "solid"
            rows.append((f"shell {index}", f"{kind} of genus {shell['genus']}, to shell {shell['target']}"))
        if self.landmarks:
            error = significant(100.0 * self.landmark_error, 2)
            met = "all met exactly" if self.landmark_error < 1e-9 else f"met to {error} % of the diagonal at worst"
            rows.append(("landmarks", f"{self.landmarks}, {met}"))
        rows.append(
            (
                "stretched",
                f"{percent(stretch['share'])} of the domain's area and {percent(stretch['target']['share'])} of the target's by more than a "
                f"factor of {significant(stretch['factor'])} (up to {percent(stretch['limit'])} and {percent(stretch['target']['limit'])} are "
                "expected)",
            )
        )
        if self.isometry_defect is not None:
            rows.append(("isometry", f"defect {significant(self.isometry_defect, 2)} of the functional map (0 for an isometry)"))
        rows.append(("time", f"{self.seconds['total']:.1f} s"))
        rows.extend(("warning", warning) for warning in self.warnings)
        return rows


class BoundaryCheck(_Text):
    """Whether a boundary map is one to one, and how far it distorts."""

    vertices: int
    faces: int
    compared_with: Dict[str, Any]
    verdict: str
    degree: Optional[Dict[str, Any]]
    flipped: int
    degenerate: int
    flat_in_domain: int
    folded_edges: int
    coverage: Optional[Dict[str, Any]]
    distortion: Optional[Dict[str, Any]]
    self_intersections: Dict[str, Any]
    composition: Optional[Dict[str, Any]]
    findings: List[Finding]
    worst_places: List[WorstPlace]


class EnergyReport(Report):
    """Energies of a map, and how they are distributed."""

    map_kind: str
    cells: int
    points: int
    harmonic_energy: float
    deformation_energy: float
    errors: Optional[Dict[str, Any]]
    normalized: bool
    volume: float
    target_volume: float
    harmonic_density: Dict[str, float]
    deformation_density: Dict[str, float]
    det_jacobian: Dict[str, float]
    folded: Dict[str, Any]
    worst_places: List[WorstPlace]
    warnings: List[str]

    def _rows(self) -> Rows:
        def row(key: str, name: str, density: Dict[str, float]) -> Any:
            error = "" if self.errors is None else f" ± {self.errors[key]:.1e}"
            spread = f"density {density['min']:.3e} to {density['max']:.3e}, median {density['median']:.3e}"
            return name, f"{significant(getattr(self, key), 6)}{error}   {spread}"

        det = self.det_jacobian
        return [
            row("harmonic_energy", "harmonic energy", self.harmonic_density),
            row("deformation_energy", "deformation energy", self.deformation_density),
            ("", "both solids at unit volume" if self.normalized else "in model units"),
            ("volume", f"{significant(self.volume, 6)} → {significant(self.target_volume, 6)}"),
            ("det J", f"{det['min']:.3e} to {det['max']:.3e}, median {det['median']:.3e}"),
            ("folded", f"{percent(self.folded['fraction'])} of the volume, {self.folded['points']} points"),
        ]


class DistortionReport(Report):
    """Means over the domain of the usual metrics of distortion."""

    mean: Optional[Dict[str, float]]
    mean_normalized: Optional[Dict[str, float]]
    determinants: Optional[Dict[str, Any]]
    not_finite: int


class CertificateReport(Report):
    """Where a map is proved to preserve orientation, where it is proved to fold, and where neither."""

    map_kind: str
    volume: float
    positive: Dict[str, Any]
    folded: Dict[str, Any]
    undecided: Dict[str, Any]
    undecided_negative: float
    det_bound: Optional[float]
    sigma_min: Optional[float]
    sigma_min_99: Optional[float]
    finest_cell: float
    levels: int
    stop_reason: str
    volume_error: float
    mirrored: Any
    cells: int
    locally_one_to_one: bool
    folded_places: int
    undecided_places: int
    worst_places: List[WorstPlace]
    tets: Optional[int]
    domain_problems: Optional[List[str]]
    target_problems: Optional[List[str]]
    boundary_checked: Optional[bool]
    one_to_one: Optional[bool]
    #: The cells as a :class:`solidmap.Mesh`, where they were asked for.
    mesh: Any

    def plot(self, *, clip: Any = "y", **options: Any) -> Any:
        """Draw what is proved, with ``cells=True`` of the call; see :func:`solidmap.plot.certificate`."""
        from . import plot

        return plot.certificate(self, clip=clip, **options)

    def __reduce__(self) -> Any:
        return _restored_certificate, (self._data, self.mesh)

    def _rows(self) -> Rows:
        if self.map_kind == "bijective":
            problems = (self.domain_problems or []) + (self.target_problems or [])
            proved = "proved" if self.one_to_one else "; ".join(problems) or "not checked: that needs CGAL"
            return [("one to one", proved), ("tetrahedra", f"{self.tets}, none inverted")]
        rows = []
        for name, totals in (("positive", self.positive), ("folded", self.folded), ("undecided", self.undecided)):
            rows.append((name, f"{percent(totals['fraction'])} of the volume, {totals['cells']} cells"))
        rows.append(("locally one to one", "proved" if self.locally_one_to_one else "not proved"))
        return rows


def _restored_certificate(data: Dict[str, Any], mesh: Any) -> CertificateReport:
    made = CertificateReport(data)
    made.mesh = mesh
    return made


class InverseReport(Report):
    """Summary of the search for preimages."""

    points: int
    ok: int
    folded: int
    several: int
    outside: int
    not_converged: int
    not_finite: int
    beyond_boundary: int
    farthest_beyond: float
    boundary_error: float
    round_trip_max: float
    round_trip_rms: float
    iterations: int
    evaluations: int
    seed_nodes: int
    seconds: float
    seed_seconds: float

    def _rows(self) -> Rows:
        return [
            ("points", f"{self.points} in {self.seconds:.3f} s"),
            ("ok", str(self.ok)),
            ("folded", f"{self.folded} ({self.several} with several preimages)"),
            ("outside", str(self.outside)),
            ("not found", str(self.not_converged)),
            ("round trip", f"{self.round_trip_max:.1e} max, {self.round_trip_rms:.1e} rms of the target's diagonal"),
        ]


class CellQuality(Report):
    """Shape quality of cells."""

    min_scaled_jacobian: float
    p01_scaled_jacobian: float
    mean_scaled_jacobian: float
    min_dihedral: float
    max_dihedral: float

    def _rows(self) -> Rows:
        return [
            (
                "scaled Jacobian",
                f"at least {significant(self.min_scaled_jacobian)}, 1 % below {significant(self.p01_scaled_jacobian)}, "
                f"mean {significant(self.mean_scaled_jacobian)}",
            ),
            ("dihedral angles", f"{self.min_dihedral:.1f}° to {self.max_dihedral:.1f}°"),
        ]


class RemeshReport(Report):
    """How a mesh was carried into the target and repaired."""

    kind: str
    cells: int
    nodes: int
    boundary_nodes: int
    cell_size: Optional[float]
    off_surface: float
    padding: Optional[Dict[str, int]]
    other_boundary: Optional[Dict[str, float]]
    causes_before: Dict[str, Any]
    causes_after: Dict[str, Any]
    before: Dict[str, Any]
    after: Dict[str, Any]
    domain_quality: Optional[CellQuality]
    invalid_in_domain: int
    quality_as_mapped: Optional[CellQuality]
    quality: Optional[CellQuality]
    determinants: Optional[List[float]]
    target_to_mesh: Dict[str, float]
    mesh_to_target: Dict[str, float]
    volume: float
    target_volume: float
    memory_estimate: int
    repair: Dict[str, Any]
    largest_shift: float
    slid_nodes: int
    largest_slide: float
    largest_slide_in_cells: float
    seconds: Dict[str, float]
    inverted_cells: int
    reasons: Dict[str, int]
    min_scaled_jacobian: Optional[float]
    crossings: Dict[str, Any]
    worst_places: List[WorstPlace]

    @property
    def valid(self) -> bool:
        """Whether no cell is inverted and the boundary, as far as it was checked, does not pass through itself."""
        return self.inverted_cells == 0 and not self.crossings.get("result")

    def _rows(self) -> Rows:
        cells = {"tets": "tetrahedra"}.get(self.kind, "hexahedra")
        rows = [
            ("mesh", f"{self.cells} {cells}, {self.nodes} nodes, {self.boundary_nodes} of them on the boundary"),
            ("inverted", f"{self.before['inverted']} as mapped, {self.after['inverted']} now, decided exactly"),
        ]
        for name, quality in (("", self.quality), ("as mapped: ", self.quality_as_mapped)):
            if quality is not None:
                rows.extend((name + each, value) for each, value in quality._rows())
        rows.append(("volume", f"{significant(self.volume, 6)}, of {significant(self.target_volume, 6)}"))
        rows.append(("time", f"{self.seconds['total']:.2f} s"))
        return rows


class BijectiveReport(Report):
    """How a one-to-one map was made."""

    tets: int
    nodes: int
    boundary_nodes: int
    inverted_as_mapped: int
    cells_added: int
    min_scaled_jacobian: float
    difference_rms: float
    difference_max: float
    difference_place: List[float]
    gap: float
    boundary: str
    refinement: Optional[Dict[str, Any]]

    def _rows(self) -> Rows:
        proved = self.boundary == "one_to_one"
        return [
            (
                "bijective map",
                f"linear over {self.tets} tetrahedra, {self.nodes} nodes, {self.boundary_nodes} of them on the boundary",
            ),
            (
                "inverted",
                f"0 now, decided exactly; {self.inverted_as_mapped} as mapped; {self.cells_added} tetrahedra added",
            ),
            ("scaled Jacobian", f"at least {significant(self.min_scaled_jacobian)}"),
            ("one to one", "proved" if proved else "if the boundary does not meet itself: that was not looked for"),
            (
                "from harmonic",
                f"{self.difference_rms:.1e} rms, {self.difference_max:.1e} at most, of the target's diagonal",
            ),
        ]


class PolycubeReport(Report):
    """How a polycube was made."""

    labels: str
    smoothness: float
    features: Optional[Dict[str, float]]
    attempts: int
    turn: Optional[List[List[float]]]
    charts: int
    corners: int
    planes: List[int]
    lattice: Optional[float]
    tets_given: int
    tets: int
    inverted_at_start: int
    inverted_after_descent: int
    inverted: int
    crossings: int
    energy: float
    distortion: Optional[Dict[str, Any]]

    def _rows(self) -> Rows:
        lattice = "" if self.lattice is None else f", on a lattice of {significant(self.lattice, 4)}"
        return [
            ("polycube", f"{self.charts} charts, {self.corners} corners{lattice}"),
            ("attempts", str(self.attempts)),
            ("tetrahedra", f"{self.tets}, {self.inverted} inverted"),
        ]


class SimplifiedReport(Report):
    """The simplified model that was deformed to a polycube."""

    vertices: int
    of: int
    distortion: Dict[str, Any]

    def _rows(self) -> Rows:
        return [("simplified", f"{self.vertices} of the model's {self.of} vertices")]


class VoxelReport(Report):
    """A polycube of voxels."""

    voxels: int
    size: float
    cells: int
    missed: int
    tried: int
    distortion: Dict[str, Any]

    def _rows(self) -> Rows:
        missed = f"; {self.missed} vertices of the model are farther than a voxel from them" if self.missed else ""
        return [("polycube", f"{self.voxels} voxels of {significant(self.size, 4)}{missed}")]


class OffsetReport(Report):
    """How good an offset surface is."""

    distance: float
    vertices: int
    faces: int
    vertex_error: float
    centroid_error: float
    min_distance: float
    genus: int
    model_genus: Optional[int]
    components: int
    raw_wrap: bool

    def _rows(self) -> Rows:
        return [
            ("offset", f"{self.faces} triangles at {self.distance:.6g}"),
            ("error", f"{self.vertex_error:.2e} at vertices, {self.centroid_error:.2e} at centroids"),
            ("genus", f"{self.genus} in {self.components} component(s)"),
        ]


class TransferReport(Report):
    """What was carried."""

    map_kind: str
    points: int
    written_points: int
    without_value: int
    outside: Optional[int]
    fields: List[Dict[str, Any]]
    volume: Dict[str, Any]
    inverse: Optional[InverseReport]
    beyond_carrier: int


class FrameRow(Report):
    """A frame of a sequence."""

    frame: int
    time: float
    file: Optional[str]
    deformation_energy: Optional[float]
    harmonic_energy: Optional[float]
    errors: Optional[Dict[str, Any]]
    deformation_density: Optional[Dict[str, float]]
    boundary_error: Optional[BoundaryError]
    folded_fraction: Optional[float]
    inverted_as_mapped: Optional[int]
    volume: Optional[float]
    skipped: Optional[str]


class SequenceReport(Report):
    """Energies of the frames of a sequence, and their cycles."""

    map_kind: str
    vertices: int
    faces: int
    closed_holes: List[Dict[str, Any]]
    volume: float
    points: Optional[int]
    tets: Optional[int]
    frames_per_block: int
    own_volume: bool
    frames: List[FrameRow]
    skipped: int
    tolerance: float
    tolerance_met: bool
    cycles: Optional[Dict[str, float]]
    no_cycles: Optional[str]
    warnings: List[str]
    #: The material in each frame, as a :class:`solidmap.Transferred` without a report, ``None`` where a frame was skipped.
    material: Any

    def plot(self, **options: Any) -> Any:
        """Draw the deformation energy over time; see :func:`solidmap.plot.sequence`."""
        from . import plot

        return plot.sequence(self, **options)

    def __reduce__(self) -> Any:
        return _restored_sequence, (self._data, self.material)

    @property
    def energies(self) -> List[float]:
        """Deformation energies of the frames, NaN for those that were skipped."""
        found = (row.deformation_energy for row in self.frames)
        return [float("nan") if energy is None else energy for energy in found]

    def _rows(self) -> Rows:
        measured = [energy for energy in self.energies if energy == energy]
        rows = [
            ("reference", f"{self.vertices} vertices, {self.faces} triangles, volume {significant(self.volume, 6)}"),
            ("frames", f"{len(self.frames)}, {self.skipped} skipped"),
        ]
        if measured:
            rows.append(("deformation energy", f"{significant(min(measured), 4)} to {significant(max(measured), 4)}"))
        if self.cycles:
            rows.append(
                ("cycles", f"{significant(self.cycles['count'])}, of {significant(self.cycles['period'])} frames each")
            )
        elif self.no_cycles:
            rows.append(("cycles", self.no_cycles))
        rows.append(("tolerance", f"{self.tolerance:.1e}, {'met' if self.tolerance_met else 'missed'}"))
        return rows


def _restored_sequence(data: Dict[str, Any], material: Any) -> SequenceReport:
    made = SequenceReport(data)
    made.material = material
    return made


class ComparedMap(Report):
    """Figures of a map by one method."""

    name: str
    what: Optional[str]
    error: Optional[str]
    seconds: Optional[Dict[str, float]]
    total_seconds: Optional[float]
    tets: Optional[int]
    inverted_tets: Optional[int]
    unknowns: Optional[int]
    iterations: Optional[int]
    boundary_error: Optional[BoundaryError]
    interior_difference: Optional[Dict[str, float]]
    harmonic_energy: Optional[float]
    deformation_energy: Optional[float]
    errors: Optional[Dict[str, Any]]
    harmonic_density: Optional[Dict[str, float]]
    min_det_jacobian: Optional[float]
    det_jacobian: Optional[Dict[str, Any]]
    folded_fraction: Optional[float]
    distortion: Optional[Dict[str, float]]
    volmap: Optional[Dict[str, Any]]
    quadrature_points: Optional[int]
    remarks: Optional[List[str]]


class ReferenceReport(Report):
    """The map that others are compared with inside, and how accurate it is."""

    description: str
    boundary_error: BoundaryError
    difference_to_coarser: Dict[str, float]
    sources: int
    seconds: float


class MeshStudy(Report):
    """Maps by one method on several meshes, or with sources at several distances, and how far they are apart."""

    method: str
    runs: List[ComparedMap]
    spread: Optional[Dict[str, float]]


class TimedFrames(Report):
    """The time that the frames of a sequence take by one method."""

    method: str
    error: Optional[str]
    setup_seconds: Optional[float]
    frame_seconds: Optional[List[float]]
    together_seconds: Optional[float]
    boundary_error_p99: Optional[float]
    skipped: List[str]


class MeshMetrics(Report):
    """The metrics of VOLMAP's program for a map from mesh to mesh."""

    tets: int
    inverted: int
    conformal: Optional[Dict[str, float]]
    dirichlet: Optional[Dict[str, float]]
    symmetric_dirichlet: Optional[Dict[str, float]]
    arap: Optional[Dict[str, float]]
    mips: Optional[Dict[str, float]]
    radius_ratio: Optional[Dict[str, float]]


class Comparison(Report):
    """Maps of one boundary map by several methods, measured alike."""

    reference: Optional[ReferenceReport]
    methods: List[ComparedMap]
    equal_accuracy: List[ComparedMap]
    mesh_study: List[MeshStudy]
    sequence: List[TimedFrames]
    warnings: List[str]

    def __getitem__(self, name: str) -> ComparedMap:
        for row in self.methods:
            if row.name == name:
                return row
        raise KeyError(name)

    def _rows(self) -> Rows:
        rows = []
        for row in self.methods:
            if row.error or row.boundary_error is None:
                rows.append((row.name, str(row.error)))
                continue
            rows.append(
                (
                    row.name,
                    f"{row.total_seconds:.2f} s   boundary error {row.boundary_error.p99:.1e}   harmonic energy "
                    f"{significant(row.harmonic_energy, 5)}   folded {percent(row.folded_fraction or 0.0)}",
                )
            )
        rows.extend(("warning", warning) for warning in self.warnings)
        return rows


class TextureReport(Report):
    """How a texture was made, and how well it meets the picture."""

    fit: FitReport
    extended: str
    seams: Dict[str, Any]
    layer_thickness: List[float]
    harmonic_error: Optional[Dict[str, float]]
    surface_error: Optional[Dict[str, float]]
