//! The metrics of a map between two meshes of the same tetrahedra, with the names and the normalisation of VOLMAP's
//! program `metrics` (Cherchi & Livesu 2023).

use std::cmp::Ordering;

use rayon::prelude::*;

use super::EnergyError;
use super::distortion::{DistortionMetrics, VOLMAP_BOUND};
use super::quadrature::sum;
use crate::geometry::orientation;
use crate::mesh::TetMesh;
use crate::{Matrix3, Point};

/// Least and largest value over the tetrahedra, and a mean.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct VolmapRange {
    /// The least.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// The mean: of distortions weighted by the volumes of the images, of radius ratios plain.
    pub mean: f64,
}

/// What VOLMAP's program measures of a map that is linear over tetrahedra.
///
/// Distortions are those of [`DistortionMetrics`], of the tetrahedra whose images are not inverted, clamped to the range
/// from that of a rigid motion to [`VOLMAP_BOUND`]; `None` where all are inverted.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct VolmapMetrics {
    /// Number of tetrahedra.
    pub tets: usize,
    /// Those whose image is flat or lies the other way round, decided exactly.
    pub inverted: usize,
    /// [`DistortionMetrics::conformal`].
    pub conformal: Option<VolmapRange>,
    /// [`DistortionMetrics::dirichlet`].
    pub dirichlet: Option<VolmapRange>,
    /// [`DistortionMetrics::symmetric_dirichlet`].
    pub symmetric_dirichlet: Option<VolmapRange>,
    /// [`DistortionMetrics::arap`].
    pub arap: Option<VolmapRange>,
    /// [`DistortionMetrics::mips`].
    pub mips: Option<VolmapRange>,
    /// Circumradius over three times the inradius of the images, 1 for regular ones (Verdict); infinite for flat ones.
    pub radius_ratio: Option<VolmapRange>,
}

/// The metrics of the map that is linear over the tetrahedra of a mesh and takes its vertices to `images`. The mesh may be
/// left-handed as a whole: what counts is whether an image has the orientation that most tetrahedra have in the domain.
///
/// # Errors
///
/// [`EnergyError::ImageCount`].
pub fn volmap_metrics(domain: &TetMesh, images: &[Point]) -> Result<VolmapMetrics, EnergyError> {
    let expected = domain.vertices().len();
    if images.len() != expected {
        let found = images.len();
        return Err(EnergyError::ImageCount { expected, found });
    }
    let positive = match domain.volume() < 0.0 {
        true => Ordering::Less,
        false => Ordering::Greater,
    };
    let measured = |tet: &[u32; 4]| {
        let [before, after] = [domain.vertices(), images].map(|at| tet.map(|v| at[v as usize]));
        let [a, b, c, d] = &after;
        let is_positive = orientation(a, b, c, d) == Some(positive);
        let (from, to) = (edges(&before), edges(&after));
        let metrics = is_positive.then(|| {
            let inverse = from.try_inverse().unwrap_or(Matrix3::repeat(f64::NAN));
            DistortionMetrics::of_jacobian(&(to * inverse))
        });
        (metrics, to.determinant().abs() / 6.0, radius_ratio(&after))
    };
    let all: Vec<(Option<DistortionMetrics>, f64, f64)> = domain.tets().par_iter().map(measured).collect();
    let regular: Vec<(DistortionMetrics, f64)> = all.iter().filter_map(|t| Some((t.0?, t.1))).collect();
    let range = |of: fn(&DistortionMetrics) -> f64| {
        let least = of(&DistortionMetrics::RIGID);
        let clamped = |metrics: &DistortionMetrics| match of(metrics) {
            value if value.is_finite() => value.clamp(least, VOLMAP_BOUND),
            _ => VOLMAP_BOUND,
        };
        VolmapRange::of(regular.iter().map(|(metrics, volume)| (clamped(metrics), *volume)))
    };
    Ok(VolmapMetrics {
        tets: all.len(),
        inverted: all.len() - regular.len(),
        conformal: range(|m| m.conformal),
        dirichlet: range(|m| m.dirichlet),
        symmetric_dirichlet: range(|m| m.symmetric_dirichlet),
        arap: range(|m| m.arap),
        mips: range(|m| m.mips),
        radius_ratio: VolmapRange::of(all.iter().map(|t| (t.2, 1.0))),
    })
}

impl VolmapRange {
    /// The range and the weighted mean of pairs of a value and a weight; `None` for no pairs.
    fn of(values: impl Iterator<Item = (f64, f64)> + Clone) -> Option<Self> {
        let min = values.clone().map(|(value, _)| value).reduce(f64::min)?;
        let max = values.clone().map(|(value, _)| value).reduce(f64::max)?;
        let total = sum(values.clone().map(|(_, weight)| weight));
        let mean = sum(values.map(|(value, weight)| value * weight)) / total;
        Some(Self { min, max, mean })
    }
}

impl VolmapMetrics {
    /// The names of the columns of [`Self::row`]: those that VOLMAP's program prints, in its order.
    pub fn columns() -> Vec<String> {
        let of_metric = |(name, mean): (&str, &str)| ["min", "max", mean].map(|what| format!("{name}_{what}"));
        let metrics = ["conformal", "dirichlet", "symmetric_dirichlet", "arap", "mips3d"].map(|name| (name, "E"));
        let counts = ["num_tets", "num_inv_tets"].map(str::to_owned);
        let all = metrics.into_iter().chain([("tet_radius_ratio", "avg")]);
        counts.into_iter().chain(all.flat_map(of_metric)).collect()
    }

    /// The values of the columns; NaN where there is none.
    pub fn row(&self) -> Vec<f64> {
        let ranges = [
            self.conformal,
            self.dirichlet,
            self.symmetric_dirichlet,
            self.arap,
            self.mips,
            self.radius_ratio,
        ];
        let of_range = |range: Option<VolmapRange>| range.map_or([f64::NAN; 3], |r| [r.min, r.max, r.mean]);
        let counts = [self.tets as f64, self.inverted as f64];
        counts
            .into_iter()
            .chain(ranges.into_iter().flat_map(of_range))
            .collect()
    }
}

fn edges([a, b, c, d]: &[Point; 4]) -> Matrix3 {
    Matrix3::from_columns(&[b - a, c - a, d - a])
}

/// Circumradius over three times the inradius. With edges u, v, w from a corner, six times the volume V and the area A of
/// the surface, the circumradius is ‖|u|² v×w + |v|² w×u + |w|² u×v‖ / (2 · 6V), and the inradius 3V / A.
fn radius_ratio(tet: &[Point; 4]) -> f64 {
    let edges = edges(tet);
    let [u, v, w] = [0, 1, 2].map(|k| edges.column(k).into_owned());
    let (vw, wu, uv) = (v.cross(&w), w.cross(&u), u.cross(&v));
    let six_volumes = u.dot(&vw).abs();
    let area = (vw.norm() + wu.norm() + uv.norm() + (vw + wu + uv).norm()) / 2.0;
    let circumradius =
        (vw * u.norm_squared() + wu * v.norm_squared() + uv * w.norm_squared()).norm() / (2.0 * six_volumes);
    let inradius = six_volumes / (2.0 * area);
    match circumradius / (3.0 * inradius) {
        ratio if ratio.is_nan() => f64::INFINITY,
        ratio => ratio,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use crate::energy::tet_distortion;

    fn regular() -> TetMesh {
        let corners = [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]].map(Point::from);
        TetMesh::new(corners.to_vec(), vec![[0, 1, 2, 3]]).unwrap()
    }

    #[test]
    fn a_motion_of_a_regular_tetrahedron_has_the_least_values() {
        let mesh = regular();
        let turn = nalgebra::Rotation3::new(Vector::new(0.4, -1.0, 2.0));
        let images: Vec<Point> = mesh.vertices().iter().map(|p| turn * p + Vector::repeat(5.0)).collect();
        let found = volmap_metrics(&mesh, &images).unwrap();
        assert_eq!((found.tets, found.inverted), (1, 0));
        for (value, expected) in found.row()[2..]
            .iter()
            .zip([1., 3., 6., 0., 1., 1.].map(|x| [x; 3]).as_flattened())
        {
            assert!((value - expected).abs() < 1e-9, "{found:?}");
        }
        assert_eq!(VolmapMetrics::columns().len(), found.row().len());
        assert_eq!(
            VolmapMetrics::columns()[2..5],
            ["conformal_min", "conformal_max", "conformal_E"]
        );
    }

    #[test]
    fn a_corner_of_a_cube_has_the_radius_ratio_of_its_formula() {
        // Circumradius √3 / 2, inradius 1 / (3 + √3).
        let corner = [[0.; 3], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Point::from);
        let expected = 3f64.sqrt() / 2.0 * (3.0 + 3f64.sqrt()) / 3.0;
        assert!((radius_ratio(&corner) - expected).abs() < 1e-14);
        let flat = [[0.; 3], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.]].map(Point::from);
        assert_eq!(radius_ratio(&flat), f64::INFINITY);
    }

    #[test]
    fn means_are_those_of_the_distortion_report() {
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]].map(Point::from);
        let tets = vec![[0, 1, 2, 3], [4, 2, 1, 3]];
        let mesh = TetMesh::new(corners.to_vec(), tets).unwrap();
        let images: Vec<Point> = corners
            .iter()
            .map(|p| Point::new(1.3 * p.x + 0.2 * p.y * p.z, 0.4 * p.y, p.z - 0.3 * p.x))
            .collect();
        let (found, report) = (
            volmap_metrics(&mesh, &images).unwrap(),
            tet_distortion(&mesh, &images).unwrap().volmap.unwrap(),
        );
        for (range, mean) in [
            (found.conformal, report.conformal),
            (found.dirichlet, report.dirichlet),
            (found.symmetric_dirichlet, report.symmetric_dirichlet),
            (found.arap, report.arap),
            (found.mips, report.mips),
        ] {
            assert!((range.unwrap().mean / mean - 1.0).abs() < 1e-13, "{found:?} {report:?}");
        }
        // One folded over: left out, and counted.
        let mut folded = images;
        folded[4] = Point::new(-1.0, -1.0, -1.0);
        let found = volmap_metrics(&mesh, &folded).unwrap();
        assert_eq!((found.tets, found.inverted), (2, 1));
        assert!(volmap_metrics(&mesh, &folded[1..]).is_err());
        // Numbered the other way round, the same.
        let reversed = mesh.tets().iter().map(|&[a, b, c, d]| [b, a, c, d]).collect();
        let reversed = TetMesh::new(corners.to_vec(), reversed).unwrap();
        assert_eq!(volmap_metrics(&reversed, &folded).unwrap().inverted, 1);
    }
}
