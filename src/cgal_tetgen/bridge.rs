//! The cxx bridge. Nothing is checked here: the callers check first.

#[cxx::bridge(namespace = "solidmap::cgal_tetgen")]
pub(super) mod ffi {
    /// How a call ended: a code of `src/cgal_tetgen/cpp/core.h`, 0 when it succeeded.
    struct Outcome {
        code: i32,
        message: String,
    }

    /// Three coordinates per vertex, and three corners per triangle or four per tetrahedron.
    #[derive(Default)]
    struct Mesh {
        xyz: Vec<f64>,
        corners: Vec<u32>,
    }

    struct RefinementSizes {
        edge_size: f64,
        facet_size: f64,
        facet_angle: f64,
        facet_distance: f64,
        cell_size: f64,
        cell_radius_edge_ratio: f64,
        feature_angle: f64,
        seconds: f64,
    }

    unsafe extern "C++" {
        include!("glue.h");

        type DistanceField;

        fn check_tetgen() -> Outcome;
        fn tetgen_mesh(
            xyz: &[f64],
            triangles: &[u32],
            radius_edge_ratio: f64,
            min_dihedral: f64,
            max_volume: f64,
            out: &mut Mesh,
        ) -> Outcome;
        fn mesh3_mesh(xyz: &[f64], triangles: &[u32], sizes: &RefinementSizes, out: &mut Mesh) -> Outcome;
        fn wrap_surface(xyz: &[f64], triangles: &[u32], alpha: f64, offset: f64, out: &mut Mesh) -> Outcome;
        fn remesh_surface(
            xyz: &[f64],
            triangles: &[u32],
            edge_length: f64,
            feature_angle: f64,
            out: &mut Mesh,
        ) -> Outcome;
        fn intersecting_pairs(xyz: &[f64], triangles: &[u32], max_tested: f64, pairs: &mut Vec<u32>) -> Outcome;
        fn new_distance_field(xyz: &[f64], triangles: &[u32], outcome: &mut Outcome) -> UniquePtr<DistanceField>;
        fn closest_points(field: &DistanceField, points: &[f64], closest: &mut [f64]) -> Outcome;
        fn enclosed_volume(field: &DistanceField, volume: &mut f64) -> Outcome;
        fn points_inside(field: &DistanceField, points: &[f64], inside: &mut [u8]) -> Outcome;
    }
}
