//! Declarations for C++. What they mean is documented where users read it, in `cpp/include/solidmap`.

use super::bijective::{Bijective, bijective_new, bijective_of};
use super::hexmesh::{Hexmesh, hexmesh_defaults, make_hexmesh};
use super::maps::{
    Boundaries, Boundary, Factored, Frames, Inverse, Map, Maps, boundary_between, boundary_load, boundary_new,
    boundary_pair, boundary_to_sphere, boundary_to_torus, factor_new, factor_refined, fit, fit_defaults, frames_new,
    inverse_new, map_load, no_boundaries,
};
use super::measures::{
    certified, distortion_in_cells, distortion_on_grid, energies_in_cells, energies_on_grid, energy_densities,
    plane_section, worst_boundary_errors,
};
use super::meshes::{
    Surface, VolumeMesh, cells_hexes, cells_load, cells_tets, surface_cube, surface_load, surface_new,
    surface_polycube, surface_sphere, surface_torus,
};
use super::model_polycube::{ModelPolycube, make_model_polycube, model_polycube_defaults};
use super::polycube::{PolycubeMap, make_polycube, make_polycube_with_labels, polycube_defaults};
use super::solids::{RemeshResult, offset_surface, remesh_given, remesh_regular, tetrahedralise};
use super::{has_native, licence, version};

#[cxx::bridge(namespace = "solidmap::ffi")]
pub(super) mod ffi {
    struct Finding {
        kind: String,
        /// 0 error, 1 warning, 2 note.
        severity: u8,
        count: usize,
        vertices: Vec<u32>,
        edges: Vec<u32>,
        triangles: Vec<u32>,
        message: String,
        advice: String,
    }

    struct CellFinding {
        kind: String,
        /// As in `Finding`.
        severity: u8,
        count: usize,
        cells: Vec<u32>,
        vertices: Vec<u32>,
        places: Vec<f64>,
        message: String,
        advice: String,
    }

    struct CellReport {
        valid: bool,
        inverted: usize,
        flat: usize,
        slivers: usize,
        body_cells: Vec<usize>,
        body_volumes: Vec<f64>,
        findings: Vec<CellFinding>,
        text: String,
    }

    struct Component {
        triangles: usize,
        vertices: usize,
        genus: i64,
        area: f64,
        volume: f64,
        shell: bool,
        cavity: bool,
    }

    struct CheckReport {
        solvable: bool,
        closed: bool,
        edge_manifold: bool,
        vertex_manifold: bool,
        oriented: bool,
        outward: bool,
        /// -1: not looked for.
        self_intersections: i64,
        area: f64,
        volume: f64,
        components: Vec<Component>,
        findings: Vec<Finding>,
        text: String,
    }

    struct PairOptions {
        conformal: bool,
        /// 0 where landmarks are met exactly.
        landmarks_weight: f64,
        /// Both zero where they are not known.
        domain_up: [f64; 3],
        target_up: [f64; 3],
        most_stretched: f64,
        aligned: bool,
        improve: bool,
        /// Vertices of all loops: of the first on the domain, of its partner on the target, and so on.
        loop_vertices: Vec<u32>,
        /// How many each has.
        loop_lengths: Vec<u32>,
    }

    struct PairReport {
        angle_median: f64,
        angle_p99: f64,
        area_median: f64,
        area_p99: f64,
        stretched: f64,
        target_stretched: f64,
        looks_wrong: bool,
        isometry_defect: f64,
        landmark_error: f64,
        components: Vec<u32>,
        seconds: f64,
        warnings: Vec<String>,
    }

    struct ImproveOptions {
        max_distortion: f64,
        rounds: usize,
        tolerance: f64,
    }

    struct ImproveReport {
        energies: Vec<f64>,
        rounds: usize,
        /// 0 distortion, 1 converged, 2 rounds.
        end: u8,
        distortion_before: f64,
        distortion_after: f64,
        boundary_error_before: f64,
        boundary_error_after: f64,
        warnings: Vec<String>,
    }

    struct FitOptions {
        /// 0 adaptive, 1 offset, 2 sphere.
        placement: u8,
        placement_value: f64,
        source_ratio: f64,
        collocation_ratio: f64,
        max_sources: usize,
        max_source_ratio: f64,
        affine: bool,
        /// 0 Schwarz, 1 QR, 2 SVD.
        solver: u8,
        most_iterations: usize,
        truncation: f64,
        tolerance: f64,
        max_error_ratio: f64,
        max_local_error: f64,
        refine: bool,
        free_sources: bool,
        /// 0: nine tenths of what is available.
        memory: u64,
        held_out: usize,
        seed: u64,
    }

    struct FitReport {
        vertices: usize,
        triangles: usize,
        sources: usize,
        collocation: usize,
        method: String,
        iterations: usize,
        refinements: usize,
        refinement_end: String,
        /// Whether sources were free; what became of them has no meaning otherwise.
        has_free_sources: bool,
        free_rounds: usize,
        free_end: String,
        free_residual_before: f64,
        free_residual_after: f64,
        free_rms_before: f64,
        free_p99_before: f64,
        free_max_before: f64,
        free_kept: bool,
        rms: f64,
        p99: f64,
        max: f64,
        local_p99: f64,
        local_max: f64,
        residual_rms: f64,
        c_error: f64,
        seconds_total: f64,
        seconds_sampling: f64,
        seconds_factor: f64,
        seconds_solve: f64,
        seconds_check: f64,
        warnings: Vec<String>,
    }

    struct FrameImages {
        images: Vec<f64>,
        boundary_rms: f64,
        left_out: f64,
        solved: usize,
    }

    struct Preimage {
        point: [f64; 3],
        round_trip: f64,
        preimages: usize,
        status: u8,
        beyond_boundary: bool,
    }

    struct BijectiveReport {
        tets: usize,
        nodes: usize,
        boundary_nodes: usize,
        inverted_as_mapped: usize,
        cells_added: usize,
        min_scaled_jacobian: f64,
        difference_rms: f64,
        difference_max: f64,
        difference_place: [f64; 3],
        gap: f64,
        boundary_one_to_one: bool,
    }

    struct Distribution {
        min: f64,
        median: f64,
        p99: f64,
        max: f64,
    }

    struct EnergyReport {
        harmonic: f64,
        deformation: f64,
        harmonic_error: f64,
        deformation_error: f64,
        volume: f64,
        target_volume: f64,
        harmonic_density: Distribution,
        deformation_density: Distribution,
        det_jacobian: Distribution,
        folded_points: usize,
        folded_fraction: f64,
        folded_error: f64,
        worst_places: Vec<WorstPlace>,
    }

    struct WorstPlace {
        /// The number of the kind in `cpp/include/solidmap/worst_place.hpp`.
        kind: u8,
        count: usize,
        point: [f64; 3],
        centre: [f64; 3],
        low: [f64; 3],
        high: [f64; 3],
        measure: f64,
        share: f64,
        value: f64,
    }

    struct VerdictTotals {
        cells: usize,
        places: usize,
        volume: f64,
        fraction: f64,
    }

    struct CertificateReport {
        positive: VerdictTotals,
        folded: VerdictTotals,
        undecided: VerdictTotals,
        undecided_negative: f64,
        sigma_min_99: f64,
        locally_one_to_one: bool,
        mirrored_parts: usize,
        parts: usize,
        worst_places: Vec<WorstPlace>,
    }

    struct EnergyDensities {
        harmonic: Vec<f64>,
        deformation: Vec<f64>,
        det_jacobian: Vec<f64>,
    }

    /// Points are three coordinates each, pixels a column and a row.
    struct PlaneSection {
        size: [usize; 2],
        pixel: f64,
        area: f64,
        points: Vec<f64>,
        pixels: Vec<u32>,
        coverage: Vec<f32>,
    }

    struct Distortion {
        conformal: f64,
        dirichlet: f64,
        symmetric_dirichlet: f64,
        arap: f64,
        mips: f64,
    }

    struct DistortionReport {
        mean: Distortion,
        mean_normalized: Distortion,
        folded_points: usize,
        left_out_fraction: f64,
    }

    struct CellQuality {
        cells: usize,
        inverted: usize,
        min_scaled_jacobian: f64,
        p01_scaled_jacobian: f64,
        mean_scaled_jacobian: f64,
        min_dihedral: f64,
        max_dihedral: f64,
    }

    struct TetOptions {
        cgal: bool,
        radius_edge_ratio: f64,
        min_dihedral: f64,
        max_volume: f64,
        cell_size: f64,
        facet_distance: f64,
        feature_angle: f64,
        time_limit: f64,
        memory: u64,
    }

    struct OffsetOptions {
        alpha: f64,
        rounds: usize,
        retries: usize,
        min_fraction: f64,
        max_triangles: usize,
    }

    #[derive(Default)]
    struct OffsetReport {
        vertex_error: f64,
        centroid_error: f64,
        min_distance: f64,
        genus: usize,
        components: usize,
        alpha: f64,
        raw_wrap: bool,
    }

    struct RemeshOptions {
        repair: bool,
        slide: bool,
        keep_boundary_map: bool,
        polish: usize,
        polish_valid: bool,
        most_added: usize,
        effort: f64,
        memory: u64,
    }

    struct RemeshReport {
        nodes: usize,
        boundary_nodes: usize,
        /// How many quads of the grid's boundary have a hexahedron of the padding layer below them, and how many there are; both 0
        /// unless the cells are regular hexahedra.
        padded_quads: usize,
        boundary_quads: usize,
        quality_as_mapped: CellQuality,
        quality: CellQuality,
        /// 0 not asked, 1 nothing inverted, 2 cells inverted, 3 no gain, 4 kept, 5 undone.
        polish: u8,
        mesh_to_target_max: f64,
        mesh_to_target_mean: f64,
        target_to_mesh_max: f64,
        target_to_mesh_mean: f64,
        volume: f64,
        target_volume: f64,
        other_boundary: bool,
        other_boundary_mean: f64,
        other_boundary_largest: f64,
        largest_shift: f64,
        slid_nodes: usize,
        largest_slide: f64,
        cells_added: usize,
        boundary_edges_split: usize,
        boundary_cells_added: usize,
        from_finite_elements: bool,
        seconds: f64,
        worst_places: Vec<WorstPlace>,
    }

    struct SurfaceDistortion {
        angle_median: f64,
        angle_p99: f64,
        area_median: f64,
        area_p99: f64,
    }

    struct PolycubeOptions {
        smoothness: f64,
        /// 0: none.
        feature_angle: f64,
        most_added: f64,
        attempts: usize,
        effort: f64,
        /// Both 0: no lattice.
        lattice_along: usize,
        lattice_length: f64,
        /// 0 as given, 1 principal, 2 best.
        orientation: u8,
    }

    struct PolycubeReport {
        /// 0 graph cuts, 1 the map to the sphere, 2 the caller.
        labels: u8,
        smoothness: f64,
        /// Angle, length, and length on borders; all 0 where none was asked for.
        features: [f64; 3],
        attempts: usize,
        /// Rows of the rotation; empty if there was none.
        turn: Vec<f64>,
        charts: usize,
        corners: usize,
        planes: [usize; 3],
        /// 0: the planes are on no lattice.
        lattice: f64,
        tets_given: usize,
        tets: usize,
        inverted_at_start: usize,
        inverted_after_descent: usize,
        energy: f64,
        /// NaN where it was not measured.
        distortion: SurfaceDistortion,
    }

    struct ModelPolycubeOptions {
        /// 0 automatic, 1 deformed, 2 voxels.
        kind: u8,
        most_vertices: usize,
        deformation: PolycubeOptions,
    }

    struct HexmeshOptions {
        hexes: bool,
        along: usize,
        /// 0: `along`.
        length: f64,
        most_cells: usize,
        max_distance: f64,
        most_vertices: usize,
        /// As `ModelPolycubeOptions::kind`.
        polycube_kind: u8,
        polycube: PolycubeOptions,
        fit: FitOptions,
        remesh: RemeshOptions,
    }

    struct SimplifiedReport {
        vertices: usize,
        of: usize,
        distortion: SurfaceDistortion,
    }

    struct VoxelReport {
        voxels: usize,
        size: f64,
        cells: usize,
        missed: usize,
        tried: usize,
        distortion: SurfaceDistortion,
    }

    unsafe extern "C++" {
        include!("watcher.hpp");

        /// Calls the user's callback; catches what it throws, and keeps it.
        #[namespace = "solidmap::detail"]
        type Watcher;
        /// `fraction` is NaN where it is not known. False: end the work.
        fn goes_on(self: &Watcher, step: &str, fraction: f64, detail: &str) -> bool;
    }

    extern "Rust" {
        fn version() -> String;
        fn licence() -> String;
        fn has_native() -> bool;
    }

    extern "Rust" {
        type Surface;
        fn surface_new(vertices: &[f64], triangles: &[u32]) -> Result<Box<Surface>>;
        fn surface_load(path: &[u8]) -> Result<Box<Surface>>;
        fn surface_sphere(radius: f64, levels: u32) -> Result<Box<Surface>>;
        fn surface_cube(size: f64, divisions: usize) -> Result<Box<Surface>>;
        fn surface_polycube(cubes: &[i32], divisions: usize) -> Result<Box<Surface>>;
        fn surface_torus(major: f64, minor: f64, around: usize, across: usize) -> Result<Box<Surface>>;
        fn save(self: &Surface, path: &[u8]) -> Result<()>;
        fn vertices(self: &Surface) -> &[f64];
        fn triangles(self: &Surface) -> &[u32];
        fn area(self: &Surface) -> f64;
        fn volume(self: &Surface) -> f64;
        fn bounding_box(self: &Surface) -> [f64; 6];
        fn check(self: &Surface, self_intersections: bool) -> Result<CheckReport>;
        fn repaired(self: &Surface, done: &mut Vec<String>) -> Result<Box<Surface>>;
        fn with_holes_closed(self: &Surface, most_edges: usize, closed: &mut usize) -> Result<Box<Surface>>;
    }

    extern "Rust" {
        type VolumeMesh;
        fn cells_tets(nodes: &[f64], corners: &[u32], regions: &[i32]) -> Result<Box<VolumeMesh>>;
        fn cells_hexes(nodes: &[f64], corners: &[u32], regions: &[i32]) -> Result<Box<VolumeMesh>>;
        fn cells_load(path: &[u8]) -> Result<Box<VolumeMesh>>;
        fn save(self: &VolumeMesh, path: &[u8]) -> Result<()>;
        fn nodes(self: &VolumeMesh) -> &[f64];
        fn corners(self: &VolumeMesh) -> &[u32];
        fn regions(self: &VolumeMesh) -> &[i32];
        fn are_hexes(self: &VolumeMesh) -> bool;
        fn with_nodes(self: &VolumeMesh, nodes: &[f64]) -> Result<Box<VolumeMesh>>;
        fn boundary(self: &VolumeMesh, nodes: &mut Vec<u32>) -> Result<Box<Surface>>;
        fn inverted(self: &VolumeMesh) -> Result<Vec<u32>>;
        fn quality(self: &VolumeMesh) -> Result<CellQuality>;
        fn check(self: &VolumeMesh) -> Result<CellReport>;
    }

    extern "Rust" {
        type Boundary;
        fn boundary_new(domain: &Surface, images: &[f64]) -> Result<Box<Boundary>>;
        fn boundary_between(domain: &Surface, image: &Surface) -> Result<Box<Boundary>>;
        fn boundary_to_sphere(domain: &Surface, conformal: bool, watcher: &Watcher) -> Result<Box<Boundary>>;
        fn boundary_to_torus(domain: &Surface, watcher: &Watcher) -> Result<Box<Boundary>>;
        fn boundary_pair(
            domain: &Surface,
            target: &Surface,
            landmarks: &[u32],
            components: &[u32],
            options: &PairOptions,
            watcher: &Watcher,
            report: &mut PairReport,
        ) -> Result<Box<Boundary>>;
        fn boundary_load(path: &[u8]) -> Result<Box<Boundary>>;
        fn save(self: &Boundary, path: &[u8]) -> Result<()>;
        fn domain(self: &Boundary) -> Result<Box<Surface>>;
        fn target(self: &Boundary) -> Result<Box<Surface>>;
        fn images(self: &Boundary) -> &[f64];
        fn target_volume(self: &Boundary) -> Result<f64>;
        fn target_diagonal(self: &Boundary) -> Result<f64>;
        fn evaluate(self: &Boundary, triangles: &[u32], barycentric: &[f64], images: &mut [f64]) -> Result<()>;
        fn inverse(self: &Boundary) -> Result<Box<Boundary>>;
        fn improved(
            self: &Boundary,
            options: &ImproveOptions,
            watcher: &Watcher,
            report: &mut ImproveReport,
        ) -> Result<Box<Boundary>>;

        type Boundaries;
        fn no_boundaries() -> Box<Boundaries>;
        fn push(self: &mut Boundaries, boundary: &Boundary) -> Result<()>;
    }

    extern "Rust" {
        type Map;
        fn fit_defaults(preset: u8) -> FitOptions;
        fn fit(boundary: &Boundary, options: &FitOptions, watcher: &Watcher) -> Result<Box<Map>>;
        fn map_load(path: &[u8]) -> Result<Box<Map>>;
        fn save(self: &Map, path: &[u8]) -> Result<()>;
        fn evaluate(self: &Map, points: &[f64], images: &mut [f64]) -> Result<()>;
        fn jacobian(self: &Map, points: &[f64], jacobians: &mut [f64]) -> Result<()>;
        fn evaluate_with_jacobian(self: &Map, points: &[f64], images: &mut [f64], jacobians: &mut [f64]) -> Result<()>;
        fn boundary(self: &Map) -> Result<Box<Boundary>>;
        fn report(self: &Map) -> Result<FitReport>;
        fn metadata(self: &Map) -> Result<String>;
        fn sources(self: &Map) -> &[f64];
        fn coefficients(self: &Map) -> &[f64];
        fn affine(self: &Map) -> &[f64];

        type Maps;
        fn len(self: &Maps) -> usize;
        fn take(self: &mut Maps, index: usize) -> Result<Box<Map>>;

        type Factored;
        fn factor_new(domain: &Surface, options: &FitOptions, watcher: &Watcher) -> Result<Box<Factored>>;
        fn factor_refined(boundary: &Boundary, options: &FitOptions, watcher: &Watcher) -> Result<Box<Factored>>;
        fn domain(self: &Factored) -> Result<Box<Surface>>;
        fn first(self: &Factored) -> Result<Box<Map>>;
        fn solve(self: &Factored, boundary: &Boundary, watcher: &Watcher) -> Result<Box<Map>>;
        fn solve_images(self: &Factored, images: &[f64], watcher: &Watcher) -> Result<Box<Map>>;
        fn solve_many(self: &Factored, boundaries: &Boundaries, watcher: &Watcher) -> Result<Box<Maps>>;
        fn solve_many_images(self: &Factored, images: &[f64], watcher: &Watcher) -> Result<Box<Maps>>;

        type Frames;
        fn frames_new(factored: &Factored, points: &[f64], most_modes: usize) -> Result<Box<Frames>>;
        fn modes(self: &Frames) -> Result<usize>;
        fn evaluate(self: &Frames, images: &[f64], watcher: &Watcher) -> Result<FrameImages>;

        type Inverse;
        fn inverse_new(map: &Map, tolerance: f64, seed_nodes: usize, iterations: usize) -> Result<Box<Inverse>>;
        fn preimages(self: &Inverse, points: &[f64], watcher: &Watcher) -> Result<Vec<Preimage>>;

        type Bijective;
        fn bijective_new(
            map: &Map,
            mesh: &VolumeMesh,
            tolerance: f64,
            most_added: usize,
            effort: f64,
            memory: u64,
            watcher: &Watcher,
        ) -> Result<Box<Bijective>>;
        fn has_bijective(self: &Map) -> bool;
        fn bijective_of(map: &Map) -> Result<Box<Bijective>>;
        fn save(self: &Bijective, map: &Map, path: &[u8]) -> Result<()>;
        fn evaluate(self: &Bijective, points: &[f64], images: &mut [f64]) -> Result<()>;
        fn jacobian(self: &Bijective, points: &[f64], jacobians: &mut [f64]) -> Result<()>;
        fn preimages(self: &Bijective, points: &[f64]) -> Result<Vec<Preimage>>;
        fn report(self: &Bijective) -> Result<BijectiveReport>;
        fn domain(self: &Bijective) -> Result<Box<VolumeMesh>>;
        fn target(self: &Bijective) -> Result<Box<VolumeMesh>>;
    }

    extern "Rust" {
        fn energies_on_grid(
            map: &Map,
            cells: usize,
            tolerance: f64,
            normalize: bool,
            lambda: f64,
            mu: f64,
            watcher: &Watcher,
        ) -> Result<EnergyReport>;
        fn energies_in_cells(
            map: &Map,
            mesh: &VolumeMesh,
            normalize: bool,
            lambda: f64,
            mu: f64,
            watcher: &Watcher,
        ) -> Result<EnergyReport>;
        fn energy_densities(
            map: &Map,
            points: &[f64],
            normalize: bool,
            lambda: f64,
            mu: f64,
        ) -> Result<EnergyDensities>;
        fn certified(
            map: &Map,
            finest: usize,
            max_cells: usize,
            undecided: f64,
            watcher: &Watcher,
        ) -> Result<CertificateReport>;
        fn worst_boundary_errors(map: &Map, most: usize) -> Result<Vec<WorstPlace>>;
        fn plane_section(surface: &Surface, axis: u8, position: f64, up: u8, pixels: usize) -> Result<PlaneSection>;
        fn distortion_on_grid(map: &Map, cells: usize, watcher: &Watcher) -> Result<DistortionReport>;
        fn distortion_in_cells(map: &Map, mesh: &VolumeMesh, watcher: &Watcher) -> Result<DistortionReport>;
    }

    extern "Rust" {
        fn tetrahedralise(surface: &Surface, options: &TetOptions, watcher: &Watcher) -> Result<Box<VolumeMesh>>;
        fn offset_surface(
            surface: &Surface,
            distance: f64,
            options: &OffsetOptions,
            watcher: &Watcher,
            report: &mut OffsetReport,
        ) -> Result<Box<Surface>>;

        type RemeshResult;
        fn remesh_regular(
            map: &Map,
            hexes: bool,
            along: usize,
            length: f64,
            most_cells: usize,
            options: &RemeshOptions,
            watcher: &Watcher,
        ) -> Result<Box<RemeshResult>>;
        fn remesh_given(
            map: &Map,
            mesh: &VolumeMesh,
            options: &RemeshOptions,
            watcher: &Watcher,
        ) -> Result<Box<RemeshResult>>;
        fn report(self: &RemeshResult) -> Result<RemeshReport>;
        fn mesh(self: &RemeshResult) -> Result<Box<VolumeMesh>>;
        fn domain_mesh(self: &RemeshResult) -> Result<Box<VolumeMesh>>;
    }

    extern "Rust" {
        fn polycube_defaults() -> PolycubeOptions;

        type PolycubeMap;
        fn make_polycube(model: &VolumeMesh, options: &PolycubeOptions, watcher: &Watcher) -> Result<Box<PolycubeMap>>;
        fn make_polycube_with_labels(
            model: &VolumeMesh,
            triangles: &[u32],
            labels: &[u8],
            options: &PolycubeOptions,
            watcher: &Watcher,
        ) -> Result<Box<PolycubeMap>>;
        fn given_boundary(self: &PolycubeMap) -> Vec<u32>;
        fn given_labels(self: &PolycubeMap) -> Vec<u8>;
        fn model(self: &PolycubeMap) -> Result<Box<VolumeMesh>>;
        fn polycube(self: &PolycubeMap) -> Result<Box<VolumeMesh>>;
        fn boundary(self: &PolycubeMap) -> &[u32];
        fn labels(self: &PolycubeMap) -> &[u8];
        fn polycube_surface(self: &PolycubeMap) -> Result<Box<Surface>>;
        fn model_surface(self: &PolycubeMap) -> Result<Box<Surface>>;
        fn report(self: &PolycubeMap) -> PolycubeReport;

        fn model_polycube_defaults() -> ModelPolycubeOptions;

        type ModelPolycube;
        fn make_model_polycube(
            model: &VolumeMesh,
            options: &ModelPolycubeOptions,
            watcher: &Watcher,
        ) -> Result<Box<ModelPolycube>>;
        fn boundary(self: &ModelPolycube) -> Result<Box<Boundary>>;
        fn labels(self: &ModelPolycube) -> &[u8];
        fn is_deformed(self: &ModelPolycube) -> bool;
        fn take_deformed(self: &mut ModelPolycube) -> Result<Box<PolycubeMap>>;
        fn is_simplified(self: &ModelPolycube) -> bool;
        fn simplified(self: &ModelPolycube) -> Result<SimplifiedReport>;
        fn voxels(self: &ModelPolycube) -> Result<VoxelReport>;

        fn hexmesh_defaults() -> HexmeshOptions;

        type Hexmesh;
        fn make_hexmesh(model: &VolumeMesh, options: &HexmeshOptions, watcher: &Watcher) -> Result<Box<Hexmesh>>;
        fn remeshed(self: &Hexmesh) -> &RemeshResult;
        fn map(self: &Hexmesh) -> Result<Box<Map>>;
        fn crossings(self: &Hexmesh) -> usize;
        fn take_polycube(self: &mut Hexmesh) -> Result<Box<ModelPolycube>>;
    }
}
