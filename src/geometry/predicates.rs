//! Exact predicates: on which side of a plane a point lies, and which tetrahedra a map inverts.
//!
//! Shewchuk, *Adaptive precision floating-point arithmetic and fast robust geometric predicates*, Discrete &
//! Computational Geometry 18 (1997).

use std::cmp::Ordering;

use rayon::prelude::*;
use robust::{Coord3D, orient3d};

use crate::Point;
use crate::mesh::{CellList, CellMesh, HEX_CORNERS, TetMesh};

/// Numbers of cells whose orientation a map does not preserve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct FlipCounts {
    /// The image has the opposite orientation.
    pub negative: usize,
    /// The four images lie exactly in a plane.
    pub degenerate: usize,
    /// A corner in the domain, or an image, has a NaN or infinite coordinate.
    pub not_finite: usize,
    /// The tetrahedron is exactly flat in the domain, so that it has no orientation; counted only here.
    pub flat_in_domain: usize,
}

impl FlipCounts {
    /// Cells with an orientation in the domain whose images do not have it.
    pub fn count(&self) -> usize {
        self.negative + self.degenerate + self.not_finite
    }

    /// Cells, of `cells` in all, that do not have the orientation of the majority: none if a map mirrors the whole
    /// domain. Those that are flat in the domain count too.
    pub fn against_most(&self, cells: usize) -> usize {
        (self.count() + self.flat_in_domain).min(cells - self.negative)
    }

    fn of_one(domain: Option<Ordering>, image: Option<Ordering>) -> Self {
        let mut counts = Self::default();
        match (domain, image) {
            (None, _) => counts.not_finite = 1,
            (Some(Ordering::Equal), _) => counts.flat_in_domain = 1,
            (_, None) => counts.not_finite = 1,
            (_, Some(Ordering::Equal)) => counts.degenerate = 1,
            (before, after) => counts.negative = usize::from(before != after),
        }
        counts
    }

    fn plus(self, other: Self) -> Self {
        Self {
            negative: self.negative + other.negative,
            degenerate: self.degenerate + other.degenerate,
            not_finite: self.not_finite + other.not_finite,
            flat_in_domain: self.flat_in_domain + other.flat_in_domain,
        }
    }
}

/// The sign of `det(b − a, c − a, d − a)`: `Greater` for a right-handed tetrahedron, `Equal` when the points lie
/// exactly in a plane, `None` when a coordinate is NaN or infinite.
///
/// Exact for the given coordinates, whatever their common size. Only coordinates that differ among themselves by more
/// than about a hundred orders of magnitude can underflow to `Equal`.
pub fn orientation(a: &Point, b: &Point, c: &Point, d: &Point) -> Option<Ordering> {
    let points = [a, b, c, d];
    if points.iter().any(|p| p.iter().any(|x| !x.is_finite())) {
        return None;
    }
    let size = points.iter().map(|p| p.coords.amax()).fold(0.0, f64::max);
    let scale = power_of_two_near_inverse(size);
    let [a, b, c, d] = points.map(|p| Coord3D {
        x: p.x * scale,
        y: p.y * scale,
        z: p.z * scale,
    });
    // Shewchuk's determinant is that of a − d, b − d, c − d, which has the other sign.
    0.0.partial_cmp(&orient3d(a, b, c, d))
}

/// Counts the tetrahedra that a map inverts or flattens, each relative to its own orientation in the domain, with
/// [`orientation`]. `images` are those of the vertices of `domain`; `None` when the counts differ.
///
/// A map that mirrors the whole domain inverts every tetrahedron.
pub fn flipped_tets(domain: &TetMesh, images: &[Point]) -> Option<FlipCounts> {
    if images.len() != domain.vertices().len() {
        return None;
    }
    let flipped = |tet: &[u32; 4]| {
        let side = |points: &[Point]| {
            let [a, b, c, d] = tet.map(|v| &points[v as usize]);
            orientation(a, b, c, d)
        };
        FlipCounts::of_one(side(domain.vertices()), side(images))
    };
    let counts = domain.tets().par_iter().map(flipped);
    Some(counts.reduce(FlipCounts::default, FlipCounts::plus))
}

/// Counts the cells that a map inverts or flattens, as [`flipped_tets`]. A hexahedron is judged by the tetrahedra at its
/// eight corners: it is negative when all of them are, not finite or flat in the domain when one is, and otherwise
/// degenerate when they are not all as in the domain.
pub fn flipped_cells(domain: &CellMesh, images: &[Point]) -> Option<FlipCounts> {
    if images.len() != domain.nodes().len() {
        return None;
    }
    let flipped = |tet: [u32; 4]| {
        let side = |points: &[Point]| {
            let [a, b, c, d] = tet.map(|v| &points[v as usize]);
            orientation(a, b, c, d)
        };
        FlipCounts::of_one(side(domain.nodes()), side(images))
    };
    let of_hex = |hex: &[u32; 8]| {
        let corners = HEX_CORNERS.map(|corner| flipped(corner.map(|k| hex[k])));
        let at_corners = corners.into_iter().fold(FlipCounts::default(), FlipCounts::plus);
        let mut counts = FlipCounts::default();
        match at_corners {
            found if found.not_finite > 0 => counts.not_finite = 1,
            found if found.flat_in_domain > 0 => counts.flat_in_domain = 1,
            found if found.negative == corners.len() => counts.negative = 1,
            found => counts.degenerate = usize::from(found.count() > 0),
        }
        counts
    };
    let none = FlipCounts::default;
    Some(match domain.cells() {
        CellList::Tets(tets) => tets.par_iter().map(|t| flipped(*t)).reduce(none, FlipCounts::plus),
        CellList::Hexes(hexes) => hexes.par_iter().map(of_hex).reduce(none, FlipCounts::plus),
    })
}

/// A power of two that scales `size` to about one, where products of three coordinates neither overflow nor vanish.
fn power_of_two_near_inverse(size: f64) -> f64 {
    let exponent = (size.to_bits() >> 52) as i32 - 1023;
    2f64.powi((-exponent).clamp(-1022, 1022))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn p(x: f64, y: f64, z: f64) -> Point {
        Point::new(x, y, z)
    }

    fn naive(points: &[Point; 4]) -> f64 {
        let [a, b, c, d] = points;
        (b - a).dot(&(c - a).cross(&(d - a)))
    }

    fn sign(points: &[Point; 4]) -> Option<Ordering> {
        let [a, b, c, d] = points;
        orientation(a, b, c, d)
    }

    fn unit() -> [Point; 4] {
        [p(0., 0., 0.), p(1., 0., 0.), p(0., 1., 0.), p(0., 0., 1.)]
    }

    #[test]
    fn tetrahedra_are_counted_against_the_majority_even_where_a_map_mirrors_it() {
        let found = FlipCounts {
            negative: 7,
            degenerate: 1,
            not_finite: 0,
            flat_in_domain: 1,
        };
        assert_eq!([found.against_most(10), found.against_most(30)], [3, 9]);
    }

    #[test]
    fn right_handed_is_greater_and_a_swap_changes_the_orientation() {
        let [a, b, c, d] = unit();
        assert_eq!(sign(&[a, b, c, d]), Some(Ordering::Greater));
        assert_eq!(sign(&[b, a, c, d]), Some(Ordering::Less));
        assert_eq!(sign(&[a, b, c, p(0.3, 0.2, 0.0)]), Some(Ordering::Equal));
    }

    #[test]
    fn decides_points_near_a_plane_where_the_rounded_determinant_errs() {
        // The corners span the plane x + y + z = 24 with the normal (1, 1, 1). The offset of the last point is a small
        // multiple of 2⁻⁵³ and therefore known exactly.
        let [a, b, c] = [p(24.0, 0.0, 0.0), p(0.0, 24.0, 0.0), p(0.0, 0.0, 24.0)];
        let (fine, coarse) = (2f64.powi(-53), 2f64.powi(-48));
        let mut wrong = 0;
        for i in 0..32 {
            for j in 0..32 {
                for step in [-1.0, 0.0, 1.0] {
                    let (dx, dy, dz) = (i as f64 * fine, j as f64 * fine, step * coarse);
                    let points = [a, b, c, p(0.5 + dx, 0.5 + dy, 23.0 + dz)];
                    let expected = (dx + dy + dz).partial_cmp(&0.0);
                    assert_eq!(sign(&points), expected, "{i} {j} {step}");
                    wrong += usize::from(naive(&points).partial_cmp(&0.0) != expected);
                }
            }
        }
        assert!(wrong > 100, "the rounded determinant errs in {wrong} of 3072 cases");
    }

    #[test]
    fn decides_tetrahedra_of_any_size() {
        for size in [1e-300, 1e-150, 1.0, 1e150, 1e300] {
            let [a, b, c, d] = unit().map(|point| point * size);
            assert_eq!(sign(&[a, b, c, d]), Some(Ordering::Greater), "{size}");
            assert_eq!(sign(&[a, c, b, d]), Some(Ordering::Less), "{size}");
        }
        assert_eq!(sign(&[Point::origin(); 4]), Some(Ordering::Equal));
    }

    #[test]
    fn coordinates_that_are_not_finite_have_no_orientation() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for corner in 0..4 {
                let mut points = unit();
                points[corner].y = bad;
                assert_eq!(sign(&points), None);
            }
        }
    }

    #[test]
    fn counts_each_tet_against_its_own_orientation() {
        let mut vertices = unit().to_vec();
        vertices.extend([p(5., 5., 0.), p(0., 0., f64::NAN)]);
        let tets = vec![[0, 1, 2, 3], [1, 0, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]];
        let domain = TetMesh::new(vertices.clone(), tets).unwrap();
        let count = |image: &dyn Fn(&Point) -> Point| {
            flipped_tets(&domain, &vertices.iter().map(image).collect::<Vec<_>>()).unwrap()
        };
        let kept = FlipCounts {
            not_finite: 1,
            flat_in_domain: 1,
            ..FlipCounts::default()
        };
        assert_eq!(count(&|v| *v), kept);
        assert_eq!(count(&|v| p(-v.x, v.y, v.z)), FlipCounts { negative: 2, ..kept });
        assert_eq!(count(&|v| p(v.x, v.x, v.z)), FlipCounts { degenerate: 2, ..kept });
        let lost = count(&|_| p(f64::INFINITY, 0.0, 0.0));
        assert_eq!(lost, FlipCounts { not_finite: 3, ..kept });
        assert_eq!(lost.count(), 3);
        assert_eq!(flipped_tets(&domain, &vertices[1..]), None);
    }

    #[test]
    fn counts_each_hexahedron_by_its_corners() {
        let nodes: Vec<Point> = crate::mesh::HEXAHEDRON.map(|c| Point::from(c.map(f64::from))).to_vec();
        let hex = [0, 1, 2, 3, 4, 5, 6, 7];
        let cells = CellList::Hexes(vec![hex, [4, 5, 6, 7, 0, 1, 2, 3]]);
        let domain = CellMesh::new(nodes.clone(), cells, vec![0; 2]).unwrap();
        let count = |image: &dyn Fn(&Point) -> Point| {
            flipped_cells(&domain, &nodes.iter().map(image).collect::<Vec<_>>()).unwrap()
        };
        assert_eq!(count(&|v| *v), FlipCounts::default());
        let mirrored = count(&|v| p(-v.x, v.y, v.z));
        assert_eq!((mirrored.negative, mirrored.against_most(2)), (2, 0));
        // One corner is pushed through the opposite faces.
        let folded = count(&|v| {
            if v.x + v.y + v.z == 3.0 {
                p(-1.0, -1.0, -1.0)
            } else {
                *v
            }
        });
        assert_eq!((folded.degenerate, folded.against_most(2)), (2, 2));
        assert_eq!(count(&|v| p(v.x, f64::NAN, v.z)).not_finite, 2);
        assert_eq!(flipped_cells(&domain, &nodes[1..]), None);
    }

    #[test]
    fn finds_the_flipped_and_flat_tets_of_a_published_map() {
        let Ok(folder) = std::env::var("SOLIDMAP_MODELS") else {
            eprintln!("SKIPPED: no published map is tested; set SOLIDMAP_MODELS to the folder of models");
            return;
        };
        let read = |name: &str| crate::io::read_tets(std::path::Path::new(&folder).join("maps").join(name)).unwrap();
        let (object, cube) = (read("max_planck_object.mesh"), read("max_planck_cube.mesh"));
        let expected = FlipCounts {
            negative: 45,
            degenerate: 198,
            ..FlipCounts::default()
        };
        assert_eq!(flipped_tets(&object, cube.vertices()), Some(expected));
        let back = flipped_tets(&cube, object.vertices()).unwrap();
        assert_eq!((back.negative, back.flat_in_domain), (45, 198));
    }
}
