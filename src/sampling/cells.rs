//! Graded refinement: a partition of the surface into cells with the local spacing of the sources, and the new sources
//! and collocation points in marked cells (longest-edge bisection of Rivara, *Algorithms for refining triangular grids
//! suitable for adaptive and multigrid techniques*, IJNME 20, 1984). The caller marks cells by their error: bulk
//! marking as in Dörfler, *A convergent adaptive algorithm for Poisson's equation*, SIAM J. Numer. Anal. 33, 1996.
//!
//! A cell is a part of a triangle: the mesh and the boundary map do not change. Neighbouring cells need not match,
//! since they are never used as a mesh.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::collocation::random_barycentric;
use super::{Anchors, Collocation, SourceSite};
use crate::geometry::morton_order;
use crate::mesh::topology::{NONE, Topology};
use crate::mesh::{SurfaceMesh, SurfacePoint};
use crate::{Point, Vector};

/// A partition of the surface into triangles and parts of triangles, each with the spacing of the finest sources there.
///
/// In all functions, `domain` must be the surface that the cells were made from.
#[derive(Debug, Clone)]
pub struct SurfaceCells {
    /// In the order of their triangles.
    cells: Vec<SurfaceCell>,
    /// Barycentric corners of the cells that are parts. Bisection makes them multiples of powers of two: exact.
    parts: Vec<Corners>,
    /// Neighbour at each side of each triangle, [`NONE`] unless there is exactly one.
    across: Vec<[u32; 3]>,
}

type Corners = [[f64; 3]; 3];

#[derive(Debug, Clone, Copy)]
struct SurfaceCell {
    triangle: u32,
    /// Index of its corners, [`NONE`] for a whole triangle.
    part: u32,
    area: f64,
    /// Spacing of the finest sources there.
    spacing: f64,
}

/// Sites of new sources, and their collocation points.
#[derive(Debug, Clone)]
pub struct RefinedSites {
    /// Sites of the new sources.
    pub sites: Vec<SourceSite>,
    /// The same points of the surface, for their images.
    pub points: Vec<SurfacePoint>,
    /// Three points around each site; their areas are those of the marked cells.
    pub collocation: Collocation,
    /// Index of the site of each collocation point.
    pub owner: Vec<u32>,
}

/// A new cell. Its target area is the square of its target spacing.
#[derive(Clone, Copy)]
struct Piece {
    triangle: u32,
    corners: Corners,
    area: f64,
    target_area: f64,
}

/// Largest ratio of a piece's area to its target: halving can only reach the target to within this factor.
const TOLERANCE: f64 = std::f64::consts::SQRT_2;
/// Sides longer than this many spacings are halved even when the area is small enough.
const LONG: f64 = 3.0;
/// But not once the area is below this fraction of the target: the thinnest needles would be halved for ever.
const NEEDLE: f64 = 0.05;
/// Small pieces farther apart than this many spacings do not share a site.
const APART: f64 = 3.0;
/// Least cosine between a site's normal and its triangle's: with a larger angle, the source is too near the triangle.
const UPRIGHT: f64 = 0.75;
/// Corners of a whole triangle.
const WHOLE: Corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// The points of the three-point quadrature rule of degree 2 (Strang & Fix 1973).
const INTERIOR: Corners = [
    [2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0],
    [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
    [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0],
];

impl SurfaceCells {
    /// One cell per triangle with an area; its spacing is the mean of those of the anchors nearest to its corners.
    pub fn of_anchors(domain: &SurfaceMesh, anchors: &Anchors) -> Self {
        let spacing_at = |v: u32| Some(anchors.spacing[anchors.nearest[v as usize]? as usize]);
        let cell = |t: usize| {
            let area = domain.area_vector(t).norm();
            let known = domain.triangles()[t].iter().filter_map(|&v| spacing_at(v));
            let (sum, count) = known.fold((0.0, 0), |(sum, count), h| (sum + h, count + 1));
            (area > 0.0).then_some(SurfaceCell {
                triangle: t as u32,
                part: NONE,
                area,
                spacing: if count > 0 {
                    sum / f64::from(count)
                } else {
                    (2.0 * area).sqrt()
                },
            })
        };
        Self {
            cells: (0..domain.triangles().len()).into_par_iter().filter_map(cell).collect(),
            parts: Vec::new(),
            across: triangles_across(domain),
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether there are none, because the surface has no area.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Area of a cell. They sum to the surface's.
    pub fn area(&self, cell: usize) -> f64 {
        self.cells[cell].area
    }

    /// Corners of a cell, barycentric in its triangle.
    fn corners(&self, cell: usize) -> Corners {
        match self.cells[cell].part {
            NONE => WHOLE,
            part => self.parts[part as usize],
        }
    }

    /// `per_cell` points at random in each cell, and the cell of each, for estimating the error cell by cell.
    pub fn probes(&self, per_cell: usize, seed: u64) -> (Vec<SurfacePoint>, Vec<u32>) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // Collocation points are drawn from stream 0 and held-out points from stream 1.
        random.set_stream(2);
        let of_cells = (0..self.len()).flat_map(|cell| std::iter::repeat_n(cell, per_cell));
        of_cells
            .map(|cell| {
                let weights = random_barycentric(&mut random);
                (at(self.cells[cell].triangle, &self.corners(cell), weights), cell as u32)
            })
            .unzip()
    }

    /// Halves the spacing of the marked cells: bisects their longest sides until the area of each piece is about the
    /// square of the new spacing, and returns one site for each. Cells far smaller than that, which exist where there
    /// are fewer anchors than vertices, share sites instead. Cells are renumbered.
    ///
    /// Areas are within a factor of `√2` of a quarter of the old spacing squared, except for small cells and for
    /// needles, which are cut shorter; the new spacing is the square root of the area.
    ///
    /// # Panics
    ///
    /// When there are fewer marks than cells.
    pub fn refine(&mut self, domain: &SurfaceMesh, marked: &[bool]) -> RefinedSites {
        let pieces: Vec<Vec<Piece>> = (0..self.len())
            .into_par_iter()
            .map(|cell| {
                if marked[cell] {
                    self.cut(domain, cell)
                } else {
                    Vec::new()
                }
            })
            .collect();
        let flat: Vec<Piece> = pieces.iter().flatten().copied().collect();
        let groups = grouped(domain, &flat);
        let mut spacing = vec![0.0; flat.len()];
        for group in &groups {
            group.pieces.iter().for_each(|&k| spacing[k as usize] = group.spacing);
        }
        let refinement = self.refinement(domain, &flat, &groups);
        self.replace(marked, &pieces, &spacing);
        refinement
    }

    fn cut(&self, domain: &SurfaceMesh, cell: usize) -> Vec<Piece> {
        let corners = self.corners(cell);
        let cell = self.cells[cell];
        let target_area = cell.spacing * cell.spacing / 4.0;
        let mut done = Vec::new();
        let mut waiting = vec![Piece {
            triangle: cell.triangle,
            corners,
            area: cell.area,
            target_area,
        }];
        while let Some(piece) = waiting.pop() {
            let (side, length_squared) = piece.longest_side(domain);
            let too_long = length_squared > LONG * LONG * target_area && piece.area > NEEDLE * target_area;
            if piece.area > TOLERANCE * target_area || too_long {
                waiting.extend(piece.halves(side));
            } else {
                done.push(piece);
            }
        }
        done
    }

    fn refinement(&self, domain: &SurfaceMesh, pieces: &[Piece], groups: &[Group]) -> RefinedSites {
        let points: Vec<SurfacePoint> = groups.iter().map(|group| group.middle(domain, pieces)).collect();
        let site = |(group, point): (&Group, &SurfacePoint)| SourceSite {
            position: point.position(domain, domain.vertices()),
            normal: self.normal(domain, point, group.spacing),
            spacing: group.spacing,
        };
        RefinedSites {
            sites: groups.iter().zip(&points).map(site).collect(),
            points,
            collocation: Collocation {
                points: groups.iter().flat_map(|group| group.interior_points(pieces)).collect(),
                areas: groups.iter().flat_map(|group| [group.area / 3.0; 3]).collect(),
            },
            owner: (0..groups.len() as u32).flat_map(|site| [site; 3]).collect(),
        }
    }

    /// The triangle's normal, rotated towards a neighbour's near their common side: half-way on the side, not at all
    /// one spacing from it. This keeps sources clear of re-entrant creases and spreads them around convex ones.
    fn normal(&self, domain: &SurfaceMesh, point: &SurfacePoint, spacing: f64) -> Vector {
        let unit = |t: u32| domain.area_vector(t as usize).try_normalize(0.0).unwrap_or_default();
        let own = unit(point.triangle);
        let corners = domain.corners(point.triangle as usize);
        let double_area = 2.0 * domain.area_vector(point.triangle as usize).norm();
        let mut sum = own;
        for side in 0..3 {
            let other = self.across[point.triangle as usize][side];
            let length = (corners[(side + 1) % 3] - corners[side]).norm();
            let distance = point.barycentric[(side + 2) % 3] * double_area / length;
            if other != NONE && distance < spacing {
                sum += unit(other) * (1.0 - distance / spacing);
            }
        }
        upright(&sum, &own)
    }

    fn replace(&mut self, marked: &[bool], pieces: &[Vec<Piece>], spacing: &[f64]) {
        let mut spacing = spacing.iter();
        let (mut cells, mut parts) = (Vec::with_capacity(self.len() + spacing.len()), Vec::new());
        for (cell, old) in self.cells.iter().enumerate() {
            if !marked[cell] {
                let mut kept = *old;
                if old.part != NONE {
                    kept.part = parts.len() as u32;
                    parts.push(self.parts[old.part as usize]);
                }
                cells.push(kept);
            }
            for (piece, &spacing) in pieces[cell].iter().zip(&mut spacing) {
                let is_whole = piece.corners == WHOLE;
                cells.push(SurfaceCell {
                    triangle: piece.triangle,
                    part: if is_whole { NONE } else { parts.len() as u32 },
                    area: piece.area,
                    spacing,
                });
                parts.extend((!is_whole).then_some(piece.corners));
            }
        }
        (self.cells, self.parts) = (cells, parts);
    }
}

impl Piece {
    /// The longest side, from the corner of this index to the next, and the square of its length.
    fn longest_side(&self, domain: &SurfaceMesh) -> (usize, f64) {
        let corners = self.corners.map(|barycentric| {
            let point = SurfacePoint {
                triangle: self.triangle,
                barycentric,
            };
            point.position(domain, domain.vertices())
        });
        let length = |side: usize| (corners[(side + 1) % 3] - corners[side]).norm_squared();
        let longer = |a: (usize, f64), b: (usize, f64)| if b.1 > a.1 { b } else { a };
        longer(longer((0, length(0)), (1, length(1))), (2, length(2)))
    }

    fn halves(&self, side: usize) -> [Self; 2] {
        let (start, end) = (self.corners[side], self.corners[(side + 1) % 3]);
        let middle = [0, 1, 2].map(|k| (start[k] + end[k]) / 2.0);
        let with = |corner: usize| {
            let mut half = *self;
            half.corners[corner] = middle;
            half.area /= 2.0;
            half
        };
        [with((side + 1) % 3), with(side)]
    }

    fn centroid(&self) -> SurfacePoint {
        at(self.triangle, &self.corners, [1.0 / 3.0; 3])
    }
}

/// Pieces that share a site.
struct Group {
    pieces: Vec<u32>,
    area: f64,
    spacing: f64,
}

impl Group {
    /// Centroid of the piece in the middle.
    fn middle(&self, domain: &SurfaceMesh, pieces: &[Piece]) -> SurfacePoint {
        let position = |k: u32| pieces[k as usize].centroid().position(domain, domain.vertices());
        let weighted = self
            .pieces
            .iter()
            .map(|&k| position(k).coords * pieces[k as usize].area);
        let mean = Point::from(weighted.sum::<Vector>() / self.area);
        let distance = |k: &&u32| (position(**k) - mean).norm_squared();
        let nearest = self.pieces.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        pieces[*nearest.expect("groups have pieces") as usize].centroid()
    }

    /// Three points, each in the piece in the middle of its third of the area.
    fn interior_points(&self, pieces: &[Piece]) -> [SurfacePoint; 3] {
        [0, 1, 2].map(|third| {
            let mut left = (third as f64 + 0.5) / 3.0 * self.area;
            let holds = |k: &&u32| {
                left -= pieces[**k as usize].area;
                left < 0.0
            };
            let k = self.pieces.iter().find(holds).or(self.pieces.last());
            let piece = &pieces[*k.expect("groups have pieces") as usize];
            at(piece.triangle, &piece.corners, INTERIOR[third])
        })
    }
}

/// One group per piece, but small pieces are grouped with their neighbours on a space-filling curve.
fn grouped(domain: &SurfaceMesh, pieces: &[Piece]) -> Vec<Group> {
    let is_small = |k: &u32| pieces[*k as usize].area * TOLERANCE < pieces[*k as usize].target_area;
    let (small, alone): (Vec<u32>, Vec<u32>) = (0..pieces.len() as u32).partition(is_small);
    let mut groups: Vec<Group> = alone
        .iter()
        .map(|&k| Group {
            pieces: vec![k],
            area: pieces[k as usize].area,
            spacing: pieces[k as usize].area.sqrt(),
        })
        .collect();
    let centroid = |&k: &u32| pieces[k as usize].centroid().position(domain, domain.vertices());
    let centroids: Vec<Point> = small.iter().map(centroid).collect();
    // The group's area over its target, and its first centroid.
    let (mut filled, mut start) = (f64::INFINITY, Point::origin());
    for i in morton_order(&centroids) {
        let (k, centroid) = (small[i as usize], centroids[i as usize]);
        let piece = &pieces[k as usize];
        let apart = (centroid - start).norm_squared() > APART * APART * piece.target_area;
        match groups.last_mut() {
            Some(group) if filled * TOLERANCE < 1.0 && !apart => {
                group.pieces.push(k);
                group.area += piece.area;
                group.spacing = group.spacing.min(piece.target_area.sqrt());
                filled += piece.area / piece.target_area;
            }
            _ => {
                groups.push(Group {
                    pieces: vec![k],
                    area: piece.area,
                    spacing: piece.target_area.sqrt(),
                });
                (filled, start) = (piece.area / piece.target_area, centroid);
            }
        }
    }
    groups
}

/// The point of a cell with these weights of its corners.
fn at(triangle: u32, corners: &Corners, weights: [f64; 3]) -> SurfacePoint {
    let coordinate = |k: usize| (0..3).map(|corner| weights[corner] * corners[corner][k]).sum();
    SurfacePoint {
        triangle,
        barycentric: [coordinate(0), coordinate(1), coordinate(2)],
    }
}

/// The unit vector in this direction, or the nearest that [`UPRIGHT`] allows.
fn upright(direction: &Vector, normal: &Vector) -> Vector {
    let unit = direction.try_normalize(1e-9).unwrap_or(*normal);
    let along = unit.dot(normal);
    if along >= UPRIGHT {
        return unit;
    }
    let across = (unit - normal * along).try_normalize(1e-9).unwrap_or_default();
    (normal * UPRIGHT + across * (1.0 - UPRIGHT * UPRIGHT).sqrt()).normalize()
}

fn triangles_across(domain: &SurfaceMesh) -> Vec<[u32; 3]> {
    let topology = Topology::new(domain);
    let mut across = vec![[NONE; 3]; domain.triangles().len()];
    for edge in 0..topology.edges().len() {
        if let &[first, second] = topology.sides(edge) {
            across[first.triangle as usize][first.corner as usize] = second.triangle;
            across[second.triangle as usize][second.corner as usize] = first.triangle;
        }
    }
    across
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SurfaceQuery;
    use crate::mesh::shapes;
    use crate::sampling::{held_out, place_sources};
    use rand::Rng;

    fn cells_of_all_vertices(domain: &SurfaceMesh) -> SurfaceCells {
        SurfaceCells::of_anchors(domain, &Anchors::choose(domain, usize::MAX))
    }

    fn total_area(cells: &SurfaceCells) -> f64 {
        (0..cells.len()).map(|cell| cells.area(cell)).sum()
    }

    fn area_of(domain: &SurfaceMesh, cells: &SurfaceCells, cell: usize) -> f64 {
        let [a, b, c] = cells.corners(cell).map(|barycentric| {
            let triangle = cells.cells[cell].triangle;
            SurfacePoint { triangle, barycentric }.position(domain, domain.vertices())
        });
        (b - a).cross(&(c - a)).norm() / 2.0
    }

    fn solids() -> Vec<(&'static str, SurfaceMesh)> {
        vec![
            ("cube", shapes::cube(1.0, 1)),
            ("L", shapes::polycube(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], 1)),
            ("shell", shapes::spherical_shell(1.0, 0.6, 2)),
            ("torus", shapes::torus(1.0, 0.4, 24, 12)),
        ]
    }

    #[test]
    fn cells_partition_the_surface_after_any_refinements() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for (name, domain) in solids() {
            let mut cells = cells_of_all_vertices(&domain);
            for _ in 0..4 {
                let marked: Vec<bool> = (0..cells.len()).map(|_| random.random_bool(0.4)).collect();
                cells.refine(&domain, &marked);
                assert!((total_area(&cells) / domain.area() - 1.0).abs() < 1e-12, "{name}");
            }
            for cell in 0..cells.len() {
                assert!((area_of(&domain, &cells, cell) / cells.area(cell) - 1.0).abs() < 1e-9);
            }
            for point in held_out(&domain, 300, 0, 5) {
                let holding = (0..cells.len()).filter(|&cell| holds(&cells, cell, &point)).count();
                assert_eq!(holding, 1, "{name}");
            }
        }
    }

    /// Whether the point is in the cell: the triangles that it forms with the three sides have the same orientation.
    fn holds(cells: &SurfaceCells, cell: usize, point: &SurfacePoint) -> bool {
        let corners = cells.corners(cell).map(Vector::from);
        let p = Vector::from(point.barycentric);
        let orientation = |k: usize| p.dot(&corners[k].cross(&corners[(k + 1) % 3]));
        let first = orientation(0) > 0.0;
        cells.cells[cell].triangle == point.triangle && (1..3).all(|k| (orientation(k) > 0.0) == first)
    }

    #[test]
    fn spacing_halves_with_each_refinement() {
        for (name, domain) in solids() {
            let mut cells = cells_of_all_vertices(&domain);
            for _ in 0..3 {
                let before: Vec<f64> = (0..cells.len()).map(|cell| cells.cells[cell].spacing).collect();
                let triangle_of: Vec<u32> = (0..cells.len()).map(|cell| cells.cells[cell].triangle).collect();
                let refinement = cells.refine(&domain, &vec![true; before.len()]);
                // The spacing of a whole triangle is the mean of three neighbourhoods.
                let (mean_before, mean_after) = (
                    before.iter().sum::<f64>() / before.len() as f64,
                    (domain.area() / refinement.sites.len() as f64).sqrt(),
                );
                let ratio = mean_after / mean_before;
                assert!((0.4..0.62).contains(&ratio), "{name}: {ratio}");
                for (site, point) in refinement.sites.iter().zip(&refinement.points) {
                    let first = triangle_of.partition_point(|&t| t < point.triangle);
                    let ratio = site.spacing
                        / before[first..]
                            .iter()
                            .zip(&triangle_of[first..])
                            .take_while(|(_, t)| **t == point.triangle)
                            .map(|(h, _)| *h)
                            .fold(0.0, f64::max);
                    assert!(ratio < 0.5 * TOLERANCE.sqrt() + 1e-9, "{name}: {ratio}");
                }
            }
        }
    }

    #[test]
    fn collocation_stands_for_the_marked_area_and_follows_its_sites() {
        let domain = shapes::torus(1.0, 0.4, 24, 12);
        let mut cells = cells_of_all_vertices(&domain);
        let marked: Vec<bool> = (0..cells.len()).map(|cell| cell % 3 == 0).collect();
        let area: f64 = (0..cells.len()).filter(|&c| marked[c]).map(|c| cells.area(c)).sum();
        let refinement = cells.refine(&domain, &marked);
        assert!((refinement.collocation.areas.iter().sum::<f64>() / area - 1.0).abs() < 1e-12);
        assert_eq!(refinement.owner.len(), 3 * refinement.sites.len());
        for (point, &owner) in refinement.collocation.points.iter().zip(&refinement.owner) {
            let site = &refinement.sites[owner as usize];
            let position = point.position(&domain, domain.vertices());
            assert!((position - site.position).norm() < 2.0 * LONG * site.spacing);
            assert!((point.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }

    /// All cells once, then a third of them twice. None of these solids has a re-entrant corner of three faces, where a
    /// source would find no room.
    #[test]
    fn sources_of_the_sites_are_outside() {
        for (name, domain) in solids() {
            let query = SurfaceQuery::new(&domain).unwrap();
            let mut cells = cells_of_all_vertices(&domain);
            let mut random = ChaCha8Rng::seed_from_u64(8);
            for round in 0..3 {
                let marked: Vec<bool> = (0..cells.len())
                    .map(|_| round == 0 || random.random_bool(0.3))
                    .collect();
                let refinement = cells.refine(&domain, &marked);
                let placed = place_sources(&refinement.sites, 1.0, &|balls| query.are_outside(balls));
                assert_eq!(placed.dropped, 0, "{name}: of {}", refinement.sites.len());
                for (source, &site) in placed.positions.iter().zip(&placed.sites) {
                    let spacing = refinement.sites[site as usize].spacing;
                    assert!(query.signed_distance(source) > 0.1 * spacing, "{name}");
                }
            }
        }
    }

    /// A tube of 3600 needles, some hundred times as long as wide: as many sites as the area asks for, and no cut makes
    /// a piece smaller than half of [`NEEDLE`].
    #[test]
    fn needles_share_sites() {
        let domain = shapes::torus(1.0, 0.3, 3, 600);
        let anchors = Anchors::choose(&domain, 300);
        let mut cells = SurfaceCells::of_anchors(&domain, &anchors);
        for _ in 0..3 {
            let sites = (0..cells.len()).map(|c| cells.area(c) / (cells.cells[c].spacing / 2.0).powi(2));
            let expected: f64 = sites.sum();
            let refinement = cells.refine(&domain, &vec![true; cells.len()]);
            let ratio = refinement.sites.len() as f64 / expected;
            assert!((0.6..2.0).contains(&ratio), "{ratio}");
            assert!(cells.len() as f64 <= 2.0 * expected / NEEDLE + 3600.0);
            let total: f64 = refinement.collocation.areas.iter().sum();
            assert!((total / domain.area() - 1.0).abs() < 1e-12);
        }
    }

    /// Some 70 triangles per anchor: cells are so small that groups of them share a site.
    #[test]
    fn few_anchors_among_many_triangles_refine_like_a_coarse_mesh() {
        let domain = shapes::sphere(1.0, 5);
        let anchors = Anchors::choose(&domain, 300);
        let mut cells = SurfaceCells::of_anchors(&domain, &anchors);
        let refinement = cells.refine(&domain, &vec![true; domain.triangles().len()]);
        let ratio = refinement.sites.len() as f64 / 1200.0;
        assert!((0.8..1.6).contains(&ratio), "{ratio}");
        assert_eq!(cells.len(), domain.triangles().len());
        let normal_is_radial = |site: &SourceSite| site.normal.dot(&site.position.coords.normalize()) > 0.99;
        assert!(refinement.sites.iter().all(normal_is_radial));
    }

    #[test]
    fn probes_lie_in_their_cells_and_repeat_with_the_seed() {
        let domain = shapes::cube(1.0, 1);
        let mut cells = cells_of_all_vertices(&domain);
        cells.refine(&domain, &(0..12).map(|cell| cell < 5).collect::<Vec<_>>());
        let (points, of_cell) = cells.probes(3, 7);
        assert_eq!(points.len(), 3 * cells.len());
        for (point, &cell) in points.iter().zip(&of_cell) {
            assert!(holds(&cells, cell as usize, point));
        }
        assert_eq!(points, cells.probes(3, 7).0);
        assert_ne!(points, cells.probes(3, 8).0);
    }
}
