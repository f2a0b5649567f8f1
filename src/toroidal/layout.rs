//! Layouts of a surface of genus 1 in the plane, as the universal cover of a torus: from coarse to fine.
//!
//! Springs lay out a coarse mesh; its other vertices are inserted one by one, each inside the ring of its neighbours, and
//! relaxed level by level, as on the sphere.

use super::embedding::{ToroidalEmbedding, ToroidalError, require_genus_1};
use super::handles::handle_loops;
use super::knot::is_knotted;
use super::linking::meridian_class;
use super::rings::{LiftedRings, Shift, Translations, plus};
use super::springs::springs;
use crate::mesh::{SurfaceMesh, triangle_area};
use crate::spherical::{
    Curvature, EnergyWeights, Hierarchy, RelaxationStar, RestShape, better_place, point_in_kernel, positive_det,
};
use crate::{Point, Vector};

/// Vertices of the coarsest mesh.
const BASE_VERTICES: usize = 200;
/// Area of the torus in the plane: that of the unit sphere, so that the same weights serve both.
pub(crate) const TORUS_AREA: f64 = 4.0 * std::f64::consts::PI;
const WEIGHTS: EnergyWeights = EnergyWeights { angle: 1.0, area: 0.1 };
/// Rounds of relaxation of the coarsest mesh; for the vertices that a level has inserted, and for all.
const BASE_SWEEPS: usize = 100;
const NEW_SWEEPS: usize = 8;
const SWEEPS: usize = 3;
/// Rings are scaled to this size when a point inside is sought, so that the plane is nearly the sphere's tangent plane.
const RING_SIZE: f64 = 0.1;

/// A linear map of the periods that takes the class of loops that bounds in the solid to itself, up to its sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub(crate) struct LatticeMap {
    /// Whether both coordinates change their sign.
    pub is_turned: bool,
    /// How often the loop that bounds in the solid is added to one around the handle.
    pub twist: i32,
}

impl LatticeMap {
    pub fn apply(self, [i, j]: Shift) -> Shift {
        let sign = if self.is_turned { -1 } else { 1 };
        [sign * (i + self.twist * j), sign * j]
    }

    pub fn apply_to_position(self, [u, v]: [f64; 2]) -> [f64; 2] {
        let sign = if self.is_turned { -1.0 } else { 1.0 };
        [sign * (u + f64::from(self.twist) * v), sign * v]
    }
}

/// A surface of genus 1 with what its layouts have in common: the translations of its universal cover, and its hierarchy.
///
/// The first coordinate of translations is 1 along loops that bound in the solid, and the second 0; the second is 1 along a
/// loop around the handle that winds as little about it as it can.
#[derive(Debug, Clone)]
pub(crate) struct TorusSurface {
    surface: SurfaceMesh,
    translations: Vec<[Shift; 3]>,
    hierarchy: Hierarchy,
    /// For each entry of the hierarchy's rings, one after the other, the translation of that neighbour.
    ring_shifts: Vec<Shift>,
    base: LiftedRings<Translations>,
    base_vertices: Vec<u32>,
    /// Positions of `base_vertices` where springs along the edges are in balance, in units of the periods.
    base_positions: Vec<[f64; 2]>,
    periods: Periods,
}

/// The periods of a torus in the plane at height 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Periods([Vector; 2]);

impl Periods {
    /// The linear map under which a layout with this matrix of Dirichlet products keeps angles best, scaled to
    /// [`TORUS_AREA`].
    fn of_products([[a, b], [_, c]]: [[f64; 2]; 2]) -> Self {
        // The inverse of the root of the matrix, up to scale; the root of a 2 × 2 matrix is M + √det M, up to scale.
        let root = (a * c - b * b).max(0.0).sqrt();
        let (p, q, r) = (c + root, -b, a + root);
        let scale = (TORUS_AREA / (p * r - q * q)).sqrt();
        Self([Vector::new(p, q, 0.0) * scale, Vector::new(q, r, 0.0) * scale])
    }

    /// Those under which an embedding keeps angles best.
    pub fn of_embedding(embedding: &ToroidalEmbedding) -> Self {
        let surface = embedding.surface();
        let mut products = [[0.0; 2]; 2];
        for (t, corners) in surface.triangles().iter().enumerate() {
            let rest = RestShape::of_triangle(corners.map(|v| &surface.vertices()[v as usize]), 1.0);
            add_dirichlet_products(&rest, embedding.corners(t).map(|x| [x.x, x.y]), &mut products);
        }
        Self::of_products(products)
    }

    /// The same torus, its second period with that multiple of the first added that makes it lean least; and the multiple.
    pub fn upright(&self) -> (Self, f64) {
        let Self([a, b]) = *self;
        let times = -(a.dot(&b) / a.norm_squared()).round();
        (Self([a, b + a * times]), times)
    }

    /// The second period over the first, as a complex number.
    pub fn modulus(&self) -> [f64; 2] {
        let [a, b] = &self.0;
        [a.dot(b), a.x * b.y - a.y * b.x].map(|part| part / a.norm_squared())
    }

    pub fn translation(&self, [i, j]: Shift) -> Vector {
        self.0[0] * f64::from(i) + self.0[1] * f64::from(j)
    }

    /// The point of the plane at height 1 with these coordinates.
    pub fn place(&self, [u, v]: [f64; 2]) -> Vector {
        self.0[0] * u + self.0[1] * v + Vector::z()
    }

    /// The coordinates of a point of the plane.
    pub fn coordinates(&self, x: &Vector) -> [f64; 2] {
        let [a, b] = &self.0;
        let determinant = a.x * b.y - a.y * b.x;
        [
            (x.x * b.y - x.y * b.x) / determinant,
            (a.x * x.y - a.y * x.x) / determinant,
        ]
    }
}

impl TorusSurface {
    /// Prepares the surface of a solid of genus 1.
    ///
    /// # Errors
    ///
    /// When the surface is not one, passes through itself, or its hole is knotted.
    pub fn new(surface: &SurfaceMesh) -> Result<Self, ToroidalError> {
        let surface = require_genus_1(surface)?;
        let loops = handle_loops(&surface);
        let meridian = meridian_class(&surface, &loops).ok_or(ToroidalError::Crossing)?;
        let cochains = [&loops[0].cochain, &loops[1].cochain];
        let translations = translations(&surface, meridian, cochains);
        let count = surface.vertices().len();
        let hierarchy = Hierarchy::with_least(surface.vertices(), surface.triangles(), BASE_VERTICES);
        let mut base = LiftedRings::new(Translations, count, surface.triangles(), &translations);
        let ring_shifts = base.collapse(&hierarchy);
        let base_vertices: Vec<u32> = (0..count as u32).filter(|&v| !base.of(v).is_empty()).collect();
        let out_of_memory = ToroidalError::OutOfMemory { vertices: count };
        let base_positions = springs(&base, &base_vertices, count).ok_or(out_of_memory)?;
        let mut torus = Self {
            periods: Periods([Vector::x(), Vector::y()]),
            surface,
            translations,
            hierarchy,
            ring_shifts,
            base,
            base_vertices,
            base_positions,
        };
        let [[_, b], [_, c]] = torus.dirichlet_products();
        torus.twist(-(b / c).round() as i32);
        torus.periods = Periods::of_products(torus.dirichlet_products());
        Ok(torus)
    }

    pub fn surface(&self) -> &SurfaceMesh {
        &self.surface
    }

    /// By how many periods each of some closed walks along edges goes round the torus.
    pub fn turns<'a>(&self, walks: impl Iterator<Item = &'a [u32]>) -> Vec<Shift> {
        let count = self.surface.vertices().len();
        let rings = LiftedRings::new(Translations, count, self.surface.triangles(), &self.translations);
        let along = |walk: &[u32]| {
            let next = walk.iter().cycle().skip(1);
            let steps = walk
                .iter()
                .zip(next)
                .filter_map(|(v, w)| rings.of(*v).iter().find(|r| r.0 == *w));
            steps.fold([0; 2], |sum, step| plus(sum, step.1))
        };
        walks.map(along).collect()
    }

    /// Adds the loop that bounds in the solid so often to that around the handle.
    fn twist(&mut self, twist: i32) {
        let map = LatticeMap {
            is_turned: false,
            twist,
        };
        for shift in self.translations.iter_mut().flatten().chain(&mut self.ring_shifts) {
            *shift = map.apply(*shift);
        }
        self.base.transform(map);
        for x in &mut self.base_positions {
            *x = map.apply_to_position(*x);
        }
    }

    /// Dirichlet products of the two coordinates of the springs.
    fn dirichlet_products(&self) -> [[f64; 2]; 2] {
        let (triangles, shifts) = self.base.triangles();
        let mut products = [[0.0; 2]; 2];
        for (t, shifts) in triangles.iter().zip(&shifts) {
            let rest = RestShape::of_triangle(t.map(|v| &self.surface.vertices()[v as usize]), 1.0);
            let at = |k: usize, axis: usize| self.base_positions[t[k] as usize][axis] + f64::from(shifts[k][axis]);
            add_dirichlet_products(&rest, [0, 1, 2].map(|k| [at(k, 0), at(k, 1)]), &mut products);
        }
        products
    }

    /// The coarsest layout.
    pub fn base_layout(&self) -> PartialLayout {
        let mut layout = PartialLayout {
            rings: self.base.clone(),
            places: vec![Vector::zeros(); self.surface.vertices().len()],
            periods: self.periods,
            map: LatticeMap::default(),
            inserted: self.base_vertices.clone(),
            level_start: 0,
            levels: 0,
        };
        for &v in &self.base_vertices {
            layout.places[v as usize] = self.periods.place(self.base_positions[v as usize]);
        }
        layout.relax(self.surface.vertices(), 0, BASE_SWEEPS);
        layout
    }

    /// The surface laid out for low distortion of angles, with that of areas bounded: with about so many vertices, and with
    /// all.
    ///
    /// # Errors
    ///
    /// [`ToroidalError::TooFine`].
    pub fn layouts(&self, coarse: usize) -> Result<(PartialLayout, PartialLayout), ToroidalError> {
        let points = self.surface.vertices();
        let mut layout = self.base_layout();
        let relax = |layout: &mut PartialLayout| {
            layout.relax(points, layout.level_start, NEW_SWEEPS);
            layout.relax(points, 0, SWEEPS);
        };
        layout.refine(self, coarse, relax).ok_or(ToroidalError::TooFine)?;
        let first = layout.clone();
        layout.refine(self, usize::MAX, relax).ok_or(ToroidalError::TooFine)?;
        Ok((first, layout))
    }

    /// # Errors
    ///
    /// [`ToroidalError::KnottedHole`] when no loop on the surface bounds a disk in the solid: then the loop that bounds in it is
    /// a knot.
    pub fn require_unknotted(&self, embedding: &ToroidalEmbedding) -> Result<(), ToroidalError> {
        match is_knotted(&meridian(embedding)) {
            true => Err(ToroidalError::KnottedHole),
            false => Ok(()),
        }
    }

    /// The embedding that a complete layout is.
    pub fn embedded(&self, layout: &PartialLayout) -> Result<ToroidalEmbedding, ToroidalError> {
        let positions: Vec<[f64; 2]> = layout.places.iter().map(|x| layout.periods.coordinates(x)).collect();
        let translations: Vec<[Shift; 3]> = self
            .translations
            .iter()
            .map(|shifts| shifts.map(|shift| layout.map.apply(shift)))
            .collect();
        ToroidalEmbedding::new(self.surface.clone(), &positions, &translations).map_err(|error| match error {
            // Layouts have positive triangles: rounding has flipped some.
            ToroidalError::NotBijective(_) => ToroidalError::TooFine,
            error => error,
        })
    }
}

/// Adds those of a triangle whose corners have these coordinates.
fn add_dirichlet_products(rest: &RestShape, corners: [[f64; 2]; 3], products: &mut [[f64; 2]; 2]) {
    for k in 0..3 {
        let [p, q] = [corners[(k + 1) % 3], corners[(k + 2) % 3]];
        let side = [p[0] - q[0], p[1] - q[1]];
        for (row, a) in products.iter_mut().zip(side) {
            for (entry, b) in row.iter_mut().zip(side) {
                *entry += 0.5 * rest.cotangents[k] * a * b;
            }
        }
    }
}

/// The translations of the corners of each triangle: the first coordinate counts along a class that crosses `meridian` once,
/// the second along the meridian, so that the first is 1 on the meridian, and the second 0.
fn translations(surface: &SurfaceMesh, [p, q]: [i32; 2], cochains: [&Vec<[i32; 3]>; 2]) -> Vec<[Shift; 3]> {
    let [r, s] = bezout(p, q);
    let along = |t: usize, side: usize| {
        let [a, b] = cochains.map(|cochain| cochain[t][side]);
        [r * a + s * b, p * b - q * a]
    };
    let of_triangle = |t: usize| {
        let (first, last) = (along(t, 0), along(t, 2));
        [[0, 0], first, [-last[0], -last[1]]]
    };
    let mut translations: Vec<[Shift; 3]> = (0..surface.triangles().len()).map(of_triangle).collect();
    // The area that the translated triangles cover wherever vertices are: 1, or −1 where the layout would be mirrored.
    let doubled: i32 = translations.iter().map(|[_, a, b]| a[0] * b[1] - a[1] * b[0]).sum();
    if doubled < 0 {
        translations.iter_mut().flatten().for_each(|shift| shift[1] = -shift[1]);
    }
    translations
}

/// Whole numbers `r, s` with `r p + s q = 1`, for coprime `p, q`.
fn bezout(p: i32, q: i32) -> [i32; 2] {
    if q == 0 {
        // p is 1 or −1.
        return [p, 0];
    }
    let [r, s] = bezout(q, p.rem_euclid(q));
    [s, r - p.div_euclid(q) * s]
}

/// The shortest of some loops that bound in the solid: the lines of the torus along its first coordinate.
fn meridian(embedding: &ToroidalEmbedding) -> Vec<Point> {
    const LINES: usize = 16;
    let loops = (0..LINES).map(|i| line(embedding, (i as f64 + 0.5) / LINES as f64 + 1e-7));
    let length = |polygon: &Vec<Point>| -> f64 {
        let next = polygon.iter().cycle().skip(1);
        polygon.iter().zip(next).map(|(a, b)| (b - a).norm()).sum()
    };
    loops.min_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or_default()
}

/// The points of the surface along the line of the torus at this second coordinate.
fn line(embedding: &ToroidalEmbedding, height: f64) -> Vec<Point> {
    let surface = embedding.surface();
    // Where the line crosses the sides of translated triangles from below to above, by the first coordinate.
    let mut crossings: Vec<(f64, Point)> = Vec::new();
    for (t, corners) in surface.triangles().iter().enumerate() {
        let places = embedding.corners(t);
        let lowest = places.iter().map(|x| x.y).fold(f64::INFINITY, f64::min);
        let highest = places.iter().map(|x| x.y).fold(f64::NEG_INFINITY, f64::max);
        let mut level = (lowest - height).ceil() + height;
        while level < highest {
            for k in 0..3 {
                let (a, b) = (places[k], places[(k + 1) % 3]);
                // Every edge is crossed upward in one of its triangles.
                if a.y < level && b.y >= level {
                    let share = (level - a.y) / (b.y - a.y);
                    let u = a.x + share * (b.x - a.x);
                    let [p, q] = [k, (k + 1) % 3].map(|k| surface.vertices()[corners[k] as usize]);
                    crossings.push((u - u.floor(), p + (q - p) * share));
                }
            }
            level += 1.0;
        }
    }
    crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
    crossings.into_iter().map(|(_, p)| p).collect()
}

/// A layout of a simplified mesh, some of whose vertices are still to be inserted.
#[derive(Debug, Clone)]
pub(crate) struct PartialLayout {
    /// Translations are those of the surface's under [`Self::map`].
    pub rings: LiftedRings<Translations>,
    /// The place of each inserted vertex in the plane at height 1.
    pub places: Vec<Vector>,
    pub periods: Periods,
    pub map: LatticeMap,
    /// The inserted vertices, in the order of their insertion.
    pub inserted: Vec<u32>,
    /// The vertices of the last level are `inserted[level_start..]`.
    pub level_start: usize,
    /// Number of levels inserted.
    levels: usize,
}

impl PartialLayout {
    /// The complete layout that an embedding is.
    pub fn of_embedding(embedding: &ToroidalEmbedding, periods: Periods) -> Self {
        let surface = embedding.surface();
        let count = surface.vertices().len();
        let positions = embedding.positions().iter();
        Self {
            rings: LiftedRings::new(Translations, count, surface.triangles(), embedding.translations()),
            places: positions.map(|x| periods.place(*x)).collect(),
            periods,
            map: LatticeMap::default(),
            inserted: (0..count as u32).collect(),
            level_start: 0,
            levels: 0,
        }
    }

    /// Inserts vertices, level by level, until there are at least `enough`. After each level `improve` may move vertices,
    /// keeping all triangles positive. `None` when rounding leaves no place for a vertex.
    pub fn refine(&mut self, torus: &TorusSurface, enough: usize, mut improve: impl FnMut(&mut Self)) -> Option<()> {
        for level in torus.hierarchy.refinements().skip(self.levels) {
            if self.inserted.len() >= enough {
                break;
            }
            self.level_start = self.inserted.len();
            for insertion in level {
                let k = insertion.ring.len();
                let shifts = &torus.ring_shifts[insertion.first..insertion.first + k];
                let shifts: Vec<Shift> = shifts.iter().map(|&shift| self.map.apply(shift)).collect();
                let around: Vec<Vector> = insertion
                    .ring
                    .iter()
                    .zip(&shifts)
                    .map(|(&r, &shift)| self.places[r as usize] + self.periods.translation(shift))
                    .collect();
                self.places[insertion.vertex as usize] = place_in_kernel(&around)?;
                self.rings.insert(&insertion, &shifts);
                self.inserted.push(insertion.vertex);
            }
            self.levels += 1;
            improve(self);
        }
        Some(())
    }

    /// The same layout on another torus, under another map of the periods, and moved by this much in units of the periods.
    pub fn mapped(&self, periods: &Periods, map: LatticeMap, by: [f64; 2]) -> Self {
        let mut mapped = self.clone();
        mapped.periods = *periods;
        mapped.map = LatticeMap {
            is_turned: self.map.is_turned != map.is_turned,
            twist: self.map.twist + map.twist,
        };
        mapped.rings.transform(map);
        for &v in &self.inserted {
            let [a, b] = map.apply_to_position(self.periods.coordinates(&self.places[v as usize]));
            mapped.places[v as usize] = periods.place([a + by[0], b + by[1]]);
        }
        mapped
    }

    /// The triangles, and their corners' translations in the plane.
    pub fn triangles(&self) -> (Vec<[u32; 3]>, Vec<[Vector; 3]>) {
        let (triangles, shifts) = self.rings.triangles();
        let in_plane = |shifts: &[Shift; 3]| shifts.map(|shift| self.periods.translation(shift));
        (triangles, shifts.iter().map(in_plane).collect())
    }

    /// The factor that scales the area of the simplified mesh, with its vertices at `points`, to that of the torus.
    pub fn area_scale(&self, points: &[Point]) -> f64 {
        let area = |t: &[u32; 3]| triangle_area(&t.map(|v| points[v as usize]));
        let total: f64 = self.rings.triangles().0.iter().map(area).sum();
        TORUS_AREA / total.max(f64::MIN_POSITIVE)
    }

    /// Relaxes the inserted vertices from the one with index `first` on, `sweeps` times over.
    pub fn relax(&mut self, points: &[Point], first: usize, sweeps: usize) {
        let area_scale = self.area_scale(points);
        let mut star = RelaxationStar::new();
        for _ in 0..sweeps {
            for i in first..self.inserted.len() {
                let v = self.inserted[i];
                let ring = self.rings.of(v);
                star.clear();
                star.extend(ring.iter().enumerate().map(|(i, &(r, shift))| {
                    let next = ring[(i + 1) % ring.len()].0;
                    let corners = [v, r, next].map(|u| &points[u as usize]);
                    let place = self.places[r as usize] + self.periods.translation(shift);
                    (place, RestShape::of_triangle(corners, area_scale))
                }));
                let x = &self.places[v as usize];
                if let Some(x) = better_place(Curvature::Flat, x, &star, WEIGHTS, None) {
                    self.places[v as usize] = x;
                }
            }
        }
    }
}

/// A place for a vertex whose neighbours are at `ring` for which all its triangles are positive.
pub(crate) fn place_in_kernel(ring: &[Vector]) -> Option<Vector> {
    let centre = ring.iter().sum::<Vector>() / ring.len() as f64;
    let size = ring.iter().map(|x| (x - centre).norm()).fold(0.0, f64::max);
    let scale = RING_SIZE / size;
    let scaled: Vec<Vector> = ring.iter().map(|x| (x - centre) * scale + Vector::z()).collect();
    let found = point_in_kernel(&scaled)?;
    let x = centre + (found / found.z - Vector::z()) / scale;
    let mut sides = ring.iter().zip(ring.iter().cycle().skip(1));
    sides.all(|(a, b)| positive_det(&x, a, b).is_some()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// Translations around every triangle and every edge fit, whatever is collapsed, inserted, or twisted and twisted back.
    #[test]
    fn collapses_and_insertions_keep_the_translations() {
        let surface = shapes::torus(1.0, 0.4, 40, 20);
        let torus = TorusSurface::new(&surface).unwrap();
        let mut layout = torus.base_layout();
        assert!(layout.inserted.len() <= BASE_VERTICES);
        for twist in [3, -3] {
            layout = layout.mapped(&torus.periods, LatticeMap { is_turned: true, twist }, [0.0; 2]);
        }
        let doubled_area = |layout: &PartialLayout| {
            let (_, shifts) = layout.rings.triangles();
            let of = |[_, a, b]: &[Shift; 3]| a[0] * b[1] - a[1] * b[0];
            shifts.iter().map(of).sum::<i32>()
        };
        let refined = layout.refine(&torus, usize::MAX, |layout| assert_eq!(doubled_area(layout), 2));
        assert!(refined.is_some());
        let (count, triangles) = (surface.vertices().len(), torus.surface.triangles());
        let expected = LiftedRings::new(Translations, count, triangles, &torus.translations);
        for v in 0..count as u32 {
            let (own, other) = (layout.rings.of(v), expected.of(v));
            // Which copy of a vertex is the one in the layout may differ by vertex; not along closed walks.
            let place = other.iter().position(|r| r.0 == own[0].0).unwrap();
            let turned = other.iter().cycle().skip(place).take(own.len());
            assert!(own.iter().zip(turned).all(|(a, b)| a == b), "{own:?} {other:?}");
        }
    }

    #[test]
    fn springs_from_the_origin_flip_no_triangle_and_cover_the_torus_once() {
        for surface in [
            shapes::torus(1.0, 0.4, 13, 7),
            shapes::torus(1.0, 0.1, 60, 9),
            shapes::polycube(
                &[
                    [0, 0, 0],
                    [1, 0, 0],
                    [2, 0, 0],
                    [0, 1, 0],
                    [2, 1, 0],
                    [0, 2, 0],
                    [1, 2, 0],
                    [2, 2, 0],
                ],
                2,
            ),
        ] {
            let torus = TorusSurface::new(&surface).unwrap();
            let layout = torus.base_layout();
            let (triangles, shifts) = torus.base.triangles();
            let mut area = 0.0;
            for (t, shifts) in triangles.iter().zip(&shifts) {
                let [a, b, c] = [0, 1, 2].map(|k| {
                    let [u, v] = torus.base_positions[t[k] as usize];
                    Vector::new(u + f64::from(shifts[k][0]), v + f64::from(shifts[k][1]), 1.0)
                });
                assert!(positive_det(&a, &b, &c).is_some());
                area += 0.5 * crate::spherical::det(&a, &b, &c);
            }
            assert!((area - 1.0).abs() < 1e-10, "{area}");
            assert_eq!(layout.inserted.len(), torus.base_vertices.len());
        }
    }

    #[test]
    fn an_embedding_has_degree_1_and_its_first_coordinate_runs_along_the_meridian() {
        for surface in [shapes::torus(1.0, 0.4, 30, 14), shapes::torus(2.0, 0.2, 90, 8)] {
            let embedding = {
                let torus = TorusSurface::new(&surface).unwrap();
                torus.embedded(&torus.layouts(300).unwrap().1).unwrap()
            };
            let check = embedding.check();
            assert!(check.is_bijective() && (check.degree - 1.0).abs() < 1e-10);
            let meridian = meridian(&embedding);
            let turns: f64 = meridian
                .iter()
                .zip(meridian.iter().cycle().skip(1))
                .map(|(a, b)| (a.x * b.y - a.y * b.x).atan2(a.x * b.x + a.y * b.y))
                .sum();
            assert!(turns.abs() < 1e-9, "{turns}");
        }
    }

    #[test]
    fn maps_of_the_periods_of_a_layout_are_undone_by_their_inverses() {
        let shift = [5, -3];
        for is_turned in [false, true] {
            let map = LatticeMap { is_turned, twist: 4 };
            let back = LatticeMap { is_turned, twist: -4 };
            assert_eq!(back.apply(map.apply(shift)), shift);
        }
        for (p, q) in [(1, 0), (0, 1), (-1, 0), (3, 5), (-7, 4), (2, -9)] {
            let [r, s] = bezout(p, q);
            assert_eq!(r * p + s * q, 1, "{p} {q}");
        }
    }
}
