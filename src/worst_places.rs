//! Where a map is worst: connected groups of cells or triangles, found and listed alike for everything that is measured.
//!
//! What is measured gives the parts that are bad (cells that are folded, triangles with a large error) and the pairs of
//! them that touch. Groups are the connected components. Parts count as touching when they share a face, or triangles an
//! edge, so that two folds that meet at a point are two places.
//!
//! Takes a pass over the parts and pairs, and a sort of the groups. The order depends on the parts alone.

use std::fmt;

use serde::Serialize;

use crate::{Point, Vector};

/// How many places are listed where nothing else is asked for.
pub const LISTED: usize = 5;

/// Where a quantity counts as large: above the value that this share of the whole does not exceed.
pub(crate) const LARGE: f64 = 0.99;

/// What is wrong at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum PlaceKind {
    /// The map is folded; the value is the least `det J` that was found, negative also for maps that reflect.
    Folded,
    /// Neither a fold nor its absence is proved; without a value.
    Undecided,
    /// The harmonic energy density is among the largest percent; the value is the largest.
    EnergyDensity,
    /// Triangles are inverted by a boundary map; without a value.
    Flipped,
    /// Triangles have images without area; without a value.
    Degenerate,
    /// Triangles of the image pass through each other; without a value.
    SelfIntersecting,
    /// The symmetric Dirichlet energy of triangles is among the largest percent; the value is the largest.
    Distortion,
    /// Lengths change by more than a factor; the value is the largest.
    Stretched,
    /// Cells of a mesh are inverted; the value is the least scaled Jacobian.
    Inverted,
    /// The boundary error is among the largest percent; the value is the largest, as a fraction of the target's diagonal.
    BoundaryError,
    /// The boundary error is among the largest percent, and above 1, as a multiple of the spacing of the image's vertices
    /// around; the value is the largest.
    LocalError,
}

/// A connected group of cells or triangles where a map is worst.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WorstPlace {
    /// What is wrong.
    pub kind: PlaceKind,
    /// How many cells, triangles or points of a quadrature it consists of.
    pub count: usize,
    /// A point inside: the centre of the worst part, or of the largest where parts have no value.
    pub point: [f64; 3],
    /// The mean of the centres, weighted by volume or area. It may lie outside.
    pub centre: [f64; 3],
    /// Lowest corner of the bounding box.
    pub low: [f64; 3],
    /// Highest corner of the bounding box.
    pub high: [f64; 3],
    /// Volume of the cells or area of the triangles, in model units.
    pub measure: f64,
    /// That as a fraction of the whole solid or surface.
    pub share: f64,
    /// The worst value; see [`PlaceKind`].
    pub value: Option<f64>,
}

impl PlaceKind {
    /// Whether the places have a volume; otherwise they have an area.
    pub fn has_volume(self) -> bool {
        matches!(
            self,
            Self::Folded | Self::Undecided | Self::EnergyDensity | Self::Inverted
        )
    }

    /// Whether places are ordered by their size. Those of a large quantity are ordered by it.
    fn is_by_size(self) -> bool {
        !matches!(
            self,
            Self::EnergyDensity | Self::Distortion | Self::BoundaryError | Self::LocalError
        )
    }

    /// Whether the least value is the worst.
    fn is_worst_least(self) -> bool {
        matches!(self, Self::Folded | Self::Inverted)
    }

    /// In words.
    fn words(self) -> &'static str {
        match self {
            Self::Folded => "folded",
            Self::Undecided => "undecided",
            Self::EnergyDensity => "large energy density",
            Self::Flipped => "flipped",
            Self::Degenerate => "degenerate",
            Self::SelfIntersecting => "self-intersecting",
            Self::Distortion => "large distortion",
            Self::Stretched => "stretched",
            Self::Inverted => "inverted",
            Self::BoundaryError => "large boundary error",
            Self::LocalError => "beyond the next vertex",
        }
    }

    /// What its value is; empty for those without.
    fn value_words(self) -> &'static str {
        match self {
            Self::Folded => "det J",
            Self::EnergyDensity => "‖J‖²",
            Self::Distortion => "symmetric Dirichlet",
            Self::Stretched => "ratio of lengths",
            Self::Inverted => "scaled Jacobian",
            Self::BoundaryError => "of the diagonal",
            Self::LocalError => "of the image's spacing",
            Self::Undecided | Self::Flipped | Self::Degenerate | Self::SelfIntersecting => "",
        }
    }
}

/// A cell, triangle or point of a quadrature that is bad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BadPart {
    /// A point inside.
    pub point: Point,
    /// Bounding box.
    pub low: Point,
    /// Bounding box.
    pub high: Point,
    /// Volume or area.
    pub measure: f64,
    /// NaN without one.
    pub value: f64,
}

impl BadPart {
    /// The convex hull of corners, with their mean as the point inside.
    pub fn of_corners(corners: &[Point], measure: f64, value: f64) -> Self {
        let mean = corners.iter().map(|p| p.coords).sum::<Vector>() / corners.len().max(1) as f64;
        let (low, high) = corners.iter().fold(NO_BOX, |(low, high), p| around(low, high, p, p));
        Self {
            point: mean.into(),
            low,
            high,
            measure,
            value,
        }
    }
}

/// The box that every other one extends.
const NO_BOX: (Point, Point) = (
    Point::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
    Point::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
);

/// The box around two boxes; coordinates that are NaN are ignored.
fn around(low: Point, high: Point, other_low: &Point, other_high: &Point) -> (Point, Point) {
    let along = |of: fn(f64, f64) -> f64, a: &Point, b: &Point| Point::new(of(a.x, b.x), of(a.y, b.y), of(a.z, b.z));
    (along(f64::min, &low, other_low), along(f64::max, &high, other_high))
}

/// All groups of parts that `touching` pairs connect, the worst first; `whole` is the measure of the solid or surface.
///
/// Defects are ordered by their size, large quantities by their largest value, and equal ones by their first part.
pub(crate) fn places(
    kind: PlaceKind,
    parts: &[BadPart],
    touching: impl IntoIterator<Item = [u32; 2]>,
    whole: f64,
) -> Vec<WorstPlace> {
    let group_of = groups(parts.len(), touching);
    // Groups in the order of their first parts, which are their roots.
    let mut number = vec![u32::MAX; parts.len()];
    let mut found: Vec<Group> = Vec::new();
    for (part, &root) in parts.iter().zip(&group_of) {
        let slot = &mut number[root as usize];
        if *slot == u32::MAX {
            *slot = found.len() as u32;
            found.push(Group::new(part));
        }
        found[*slot as usize].add(kind, part);
    }
    let mut found: Vec<WorstPlace> = found.into_iter().map(|group| group.place(kind, whole)).collect();
    let key = |place: &WorstPlace| {
        if kind.is_by_size() {
            place.measure
        } else {
            place.value.unwrap_or(f64::INFINITY)
        }
    };
    found.sort_by(|a, b| key(b).total_cmp(&key(a)));
    found
}

/// The worst of several kinds: the first kind is listed first.
pub(crate) fn listed(kinds: impl IntoIterator<Item = Vec<WorstPlace>>, most: usize) -> Vec<WorstPlace> {
    kinds.into_iter().flatten().take(most).collect()
}

/// Pairs of parts with an equal key, such as that of a face that they share. A chain for keys of several.
pub(crate) fn sharing<K: Ord + Send>(keys: impl IntoIterator<Item = (K, u32)>) -> Vec<[u32; 2]> {
    let mut keys: Vec<(K, u32)> = keys.into_iter().collect();
    rayon::slice::ParallelSliceMut::par_sort_unstable(keys.as_mut_slice());
    let pairs = keys.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    pairs.map(|pair| [pair[0].1, pair[1].1]).collect()
}

/// Triangles of a surface, by their numbers: bad ones with their values, grouped across edges.
pub(crate) fn of_triangles(
    kind: PlaceKind,
    corners: impl Fn(u32) -> [Point; 3],
    triangles: &[[u32; 3]],
    bad: &[(u32, f64)],
    whole: f64,
) -> Vec<WorstPlace> {
    let part = |&(t, value): &(u32, f64)| {
        let corners = corners(t);
        BadPart::of_corners(&corners, crate::mesh::triangle_area(&corners), value)
    };
    let parts: Vec<BadPart> = bad.iter().map(part).collect();
    let edges = bad.iter().enumerate().flat_map(|(part, (t, _))| {
        let [a, b, c] = triangles[*t as usize];
        [[a, b], [b, c], [c, a]].map(|[p, q]| ([p.min(q), p.max(q)], part as u32))
    });
    places(kind, &parts, sharing(edges), whole)
}

/// The component of each part, by its first part.
fn groups(count: usize, touching: impl IntoIterator<Item = [u32; 2]>) -> Vec<u32> {
    let mut root: Vec<u32> = (0..count as u32).collect();
    fn find(root: &mut [u32], mut part: u32) -> u32 {
        while root[part as usize] != part {
            let next = root[root[part as usize] as usize];
            root[part as usize] = next;
            part = next;
        }
        part
    }
    for [a, b] in touching {
        let (a, b) = (find(&mut root, a), find(&mut root, b));
        root[a.max(b) as usize] = a.min(b);
    }
    (0..count as u32).map(|part| find(&mut root, part)).collect()
}

/// A group whose parts are being added.
struct Group {
    count: usize,
    worst: BadPart,
    low: Point,
    high: Point,
    measure: f64,
    /// Sum of the parts' points, weighted by their measures, and plain.
    sums: [Vector; 2],
}

impl Group {
    /// A group that the first part is still to be added to.
    fn new(first: &BadPart) -> Self {
        Self {
            count: 0,
            worst: *first,
            low: NO_BOX.0,
            high: NO_BOX.1,
            measure: 0.0,
            sums: [Vector::zeros(); 2],
        }
    }

    fn add(&mut self, kind: PlaceKind, part: &BadPart) {
        self.count += 1;
        (self.low, self.high) = around(self.low, self.high, &part.low, &part.high);
        self.measure += part.measure;
        self.sums[0] += part.point.coords * part.measure;
        self.sums[1] += part.point.coords;
        let badness = |part: &BadPart| match part.value {
            value if value.is_nan() => f64::NEG_INFINITY,
            value if kind.is_worst_least() => -value,
            value => value,
        };
        let order = badness(part).total_cmp(&badness(&self.worst));
        if order.then(part.measure.total_cmp(&self.worst.measure)).is_gt() {
            self.worst = *part;
        }
    }

    fn place(self, kind: PlaceKind, whole: f64) -> WorstPlace {
        let weighted = self.sums[0] / self.measure;
        let is_finite = weighted.iter().all(|x| x.is_finite());
        let centre = if is_finite {
            weighted
        } else {
            self.sums[1] / self.count as f64
        };
        WorstPlace {
            kind,
            count: self.count,
            point: self.worst.point.into(),
            centre: centre.into(),
            low: self.low.into(),
            high: self.high.into(),
            measure: self.measure,
            share: self.measure / whole,
            value: Some(self.worst.value).filter(|value| !value.is_nan()),
        }
    }
}

/// A table of places, for people: what is wrong, a point inside, the extents of the bounding box, volume or area, and the
/// worst value. Its `Display` gives lines, each ended; nothing without places.
#[derive(Debug, Clone, Copy)]
pub struct PlaceTable<'a>(pub &'a [WorstPlace]);

impl fmt::Display for PlaceTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return Ok(());
        }
        let size = if self.0.iter().all(|place| place.kind.has_volume()) {
            "volume"
        } else {
            "area"
        };
        let head = [
            "worst places",
            "at x",
            "y",
            "z",
            "extent x",
            "y",
            "z",
            size,
            "share",
            "worst",
        ]
        .map(String::from);
        let row = |place: &WorstPlace| {
            let extents = [0, 1, 2].map(|k| place.high[k] - place.low[k]);
            let [x, y, z] = place.point.map(|c| short(c, 4));
            let [dx, dy, dz] = extents.map(|c| short(c, 2));
            let value = place.value.map_or(String::new(), |value| {
                format!("{} {}", short(value, 3), place.kind.value_words())
            });
            let share = format!("{} %", short(100.0 * place.share, 2));
            [
                place.kind.words().into(),
                x,
                y,
                z,
                dx,
                dy,
                dz,
                short(place.measure, 2),
                share,
                value,
            ]
        };
        let rows: Vec<[String; 10]> = std::iter::once(head).chain(self.0.iter().map(row)).collect();
        let width = |k: usize| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0);
        let widths: [usize; 10] = std::array::from_fn(width);
        for row in &rows {
            let mut line = format!("{:<width$}", row[0], width = widths[0]);
            for k in 1..9 {
                line += &format!("  {:>width$}", row[k], width = widths[k]);
            }
            line += &format!("  {}", row[9]);
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// So many significant digits.
fn short(x: f64, digits: i32) -> String {
    match x.abs() {
        _ if x == 0.0 => "0".into(),
        size if !size.is_finite() => x.to_string(),
        size if !(1e-4..1e6).contains(&size) => format!("{x:.*e}", digits.max(1) as usize - 1),
        size => format!("{x:.*}", (digits - 1 - size.log10().floor() as i32).max(0) as usize),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unit cubes in a row along x.
    fn cube(x: f64, value: f64) -> BadPart {
        let low = Point::new(x, 0.0, 0.0);
        BadPart {
            point: low + Vector::repeat(0.5),
            low,
            high: low + Vector::repeat(1.0),
            measure: 1.0,
            value,
        }
    }

    #[test]
    fn connected_parts_are_one_place_and_the_largest_comes_first() {
        let parts = [cube(9.0, -1.0), cube(0.0, -2.0), cube(1.0, -4.0), cube(2.0, -3.0)];
        let found = places(PlaceKind::Folded, &parts, [[3, 2], [1, 2]], 8.0);
        assert_eq!(found.len(), 2);
        let first = found[0];
        assert_eq!((first.count, first.measure, first.share), (3, 3.0, 0.375));
        assert_eq!((first.low, first.high), ([0.0; 3], [3.0, 1.0, 1.0]));
        assert_eq!((first.centre, first.point), ([1.5, 0.5, 0.5], [1.5, 0.5, 0.5]));
        assert_eq!(first.value, Some(-4.0));
        assert_eq!((found[1].count, found[1].point), (1, [9.5, 0.5, 0.5]));
    }

    #[test]
    fn large_quantities_are_ordered_by_value_and_equal_places_by_their_parts() {
        let parts = [cube(0.0, 1.0), cube(1.0, 1.0), cube(5.0, 7.0), cube(8.0, 1.0)];
        let found = places(PlaceKind::BoundaryError, &parts, [[0, 1]], 4.0);
        let points: Vec<f64> = found.iter().map(|place| place.point[0]).collect();
        assert_eq!(points, [5.5, 0.5, 8.5]);
        let undecided = [cube(3.0, f64::NAN), cube(1.0, f64::NAN)];
        let found = places(PlaceKind::Undecided, &undecided, [], 4.0);
        assert_eq!((found[0].point[0], found[0].value), (3.5, None));
    }

    #[test]
    fn coordinates_that_are_not_numbers_spoil_no_box() {
        let corners = [
            Point::new(f64::NAN, 0.0, 0.0),
            Point::new(1.0, 2.0, 3.0),
            Point::origin(),
        ];
        let part = BadPart::of_corners(&corners, f64::NAN, f64::NAN);
        let found = places(PlaceKind::Inverted, &[part, cube(0.0, -1.0)], [[0, 1]], 1.0);
        assert_eq!((found[0].low, found[0].high), ([0.0; 3], [1.0, 2.0, 3.0]));
        assert_eq!(found[0].value, Some(-1.0));
        assert!(places(PlaceKind::Inverted, &[], [], 0.0).is_empty());
    }

    #[test]
    fn triangles_are_grouped_across_edges() {
        let cube = crate::mesh::shapes::cube(1.0, 1);
        let corners = |t: u32| cube.corners(t as usize);
        // Two triangles of one face, and the two of the opposite one: no edge between them.
        let bad: Vec<(u32, f64)> = (0..4).map(|t| (t, 0.0)).collect();
        let found = of_triangles(PlaceKind::Flipped, corners, cube.triangles(), &bad, cube.area());
        let count: usize = found.iter().map(|place| place.count).sum();
        assert_eq!(count, 4);
        let share: f64 = found.iter().map(|place| place.share).sum();
        assert!((share - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn the_table_has_a_line_for_each_place() {
        let parts = [cube(0.0, -0.25), cube(4.0, -1.0)];
        let found = places(PlaceKind::Folded, &parts, [], 8.0);
        let text = PlaceTable(&found).to_string();
        assert_eq!(text.lines().count(), 3, "{text}");
        assert!(text.contains("12 %  -0.250 det J"), "{text}");
        assert_eq!(PlaceTable(&[]).to_string(), "");
    }
}
