//! Plane sections of solids on a grid of pixels.
//!
//! Each triangle that the plane crosses gives a directed segment of the outline; along a row of the grid the segments
//! crossed so far give the winding number, and the solid is where it is not zero. Cavities, several components and
//! components that overlap need no special case.

mod outline;

use std::fmt;

use crate::Point;
use crate::mesh::SurfaceMesh;
use outline::{crossings, finite_box, outline, spans};

/// Fewest and most pixels along the longer side of a section.
const PIXELS: [usize; 2] = [16, 8192];

/// Rows of coverage samples in a pixel. Odd, so that one of them passes through the pixel's centre.
const SUBROWS: usize = 5;

/// Pixels that are covered less are left out.
const LEAST_COVERAGE: f64 = 1.0 / 256.0;

/// A coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// The first coordinate.
    X,
    /// The second coordinate.
    Y,
    /// The third coordinate.
    Z,
}

impl Axis {
    /// 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    /// The two other axes, in order.
    fn others(self) -> [Axis; 2] {
        match self {
            Axis::X => [Axis::Y, Axis::Z],
            Axis::Y => [Axis::X, Axis::Z],
            Axis::Z => [Axis::X, Axis::Y],
        }
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(["x", "y", "z"][self.index()])
    }
}

/// Why a solid has no section.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SectionError {
    /// The plane passes beside the solid, or between its parts.
    #[error(
        "the plane {axis} = {position} cuts nothing: the solid extends from {low} to {high} in {axis}; choose a \
         position where there is material"
    )]
    PlaneMissesSolid {
        /// The axis that the plane is perpendicular to.
        axis: Axis,
        /// Where it was asked for.
        position: f64,
        /// Lowest coordinate of the solid along the axis.
        low: f64,
        /// Highest coordinate of the solid along the axis.
        high: f64,
    },
    /// The plane touches the solid, or cuts parts thinner than a pixel.
    #[error(
        "the section {axis} = {position} covers no pixel of size {pixel:.3e}; move the plane into the solid or \
         ask for more pixels"
    )]
    BelowPixel {
        /// The axis that the plane is perpendicular to.
        axis: Axis,
        /// Where it was asked for.
        position: f64,
        /// Side of a pixel in model units.
        pixel: f64,
    },
    /// The section's outline does not close, because the surface has holes or triangles that disagree in
    /// orientation.
    #[error(
        "the surface does not bound a solid near ({x}, {y}, {z}): its section there does not close; close its \
         holes and orient it first"
    )]
    OpenSurface {
        /// First coordinate of a point near the gap.
        x: f64,
        /// Second coordinate.
        y: f64,
        /// Third coordinate.
        z: f64,
    },
    /// A coordinate that cannot be computed with.
    #[error("vertex {vertex} has a coordinate that is not a number, infinite or beyond 1e70 (0-based)")]
    NotFinite {
        /// Which vertex.
        vertex: usize,
    },
    /// No triangle to cut.
    #[error("the surface has no triangles, so it has no section")]
    EmptySurface,
    /// A number of pixels that is too small to see, or too large to hold.
    #[error("a section cannot have {pixels} pixels along its longer side; choose from {least} to {most}")]
    Pixels {
        /// What was asked for.
        pixels: usize,
        /// The fewest.
        least: usize,
        /// The most.
        most: usize,
    },
}

/// A plane perpendicular to a coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisPlane {
    /// The axis it is perpendicular to.
    pub axis: Axis,
    /// Where it meets the axis, in model units.
    pub position: f64,
}

/// A plane section of a solid: the pixels that it covers, a point of the solid in each, and its outline. Fields
/// evaluated at [`PlaneSection::points`], such as [`energy::densities`](crate::energy::densities), give the picture of
/// the field.
///
/// The picture frames the whole solid as seen along the axis, not the section alone, so that sections of one solid at
/// different positions can be laid side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneSection {
    plane: AxisPlane,
    /// The axes that point right and up in the picture.
    axes: [Axis; 2],
    /// Width and height in pixels.
    size: [usize; 2],
    /// Lower left corner of the picture in the plane.
    corner: [f64; 2],
    /// Side of a pixel.
    pixel: f64,
    /// Column and row (the first at the top) of each covered pixel.
    pixels: Vec<[u32; 2]>,
    coverage: Vec<f32>,
    points: Vec<Point>,
    outline: Vec<[[f64; 2]; 2]>,
    area: f64,
}

impl PlaneSection {
    /// The section of the solid that `surface` bounds, `pixels` along the longer side of the picture, with the axis
    /// `up` pointing up in it; where that is perpendicular to the plane, the later of the two others does.
    ///
    /// Where the plane passes through vertices or contains triangles, the section is the limit of those on the side
    /// of the solid's middle: a plane through an outer face of a cube gives the whole face. Costs a pass over the
    /// triangles and memory for the covered pixels.
    ///
    /// # Errors
    ///
    /// [`SectionError`].
    pub fn new(surface: &SurfaceMesh, plane: AxisPlane, up: Axis, pixels: usize) -> Result<Self, SectionError> {
        Self::framed_by(surface, plane, up, pixels, None)
    }

    /// As [`PlaneSection::new`], but the picture shows the part of the section inside a box, such as one around a
    /// [worst place](crate::worst_places); so does [`PlaneSection::area`]. The box should have an extent in the plane.
    ///
    /// # Errors
    ///
    /// [`SectionError`]; [`SectionError::BelowPixel`] where nothing of the section is in the box.
    pub fn enlarged(
        surface: &SurfaceMesh,
        plane: AxisPlane,
        up: Axis,
        pixels: usize,
        window: [Point; 2],
    ) -> Result<Self, SectionError> {
        Self::framed_by(surface, plane, up, pixels, Some(window))
    }

    fn framed_by(
        surface: &SurfaceMesh,
        plane: AxisPlane,
        up: Axis,
        pixels: usize,
        window: Option<[Point; 2]>,
    ) -> Result<Self, SectionError> {
        let [least, most] = PIXELS;
        if !(least..=most).contains(&pixels) {
            return Err(SectionError::Pixels { pixels, least, most });
        }
        let (low, high) = finite_box(surface)?;
        let along = plane.axis.index();
        let misses = || SectionError::PlaneMissesSolid {
            axis: plane.axis,
            position: plane.position,
            low: low[along],
            high: high[along],
        };
        if !(low[along] <= plane.position && plane.position <= high[along]) {
            return Err(misses());
        }
        // A plane through vertices is moved by an infinitesimal amount towards the middle, so that every vertex is
        // strictly on one side and every crossed triangle is crossed in exactly two edges.
        let on_plane_is_above = plane.position > (low[along] + high[along]) / 2.0;
        let [first, second] = plane.axis.others();
        let axes = if first == up { [second, first] } else { [first, second] };
        let outline = outline(surface, plane, axes, on_plane_is_above);
        if outline.is_empty() {
            return Err(misses());
        }
        let [low, high] = window.unwrap_or([low, high]);
        let mut section = Self::framed(plane, axes, low, high, pixels);
        section.outline = outline;
        section.cover()?;
        if section.points.is_empty() {
            return Err(SectionError::BelowPixel {
                axis: plane.axis,
                position: plane.position,
                pixel: section.pixel,
            });
        }
        Ok(section)
    }

    /// One point of the solid for each pixel of the section, on the plane: the pixel's centre where that is inside, and
    /// for a pixel on the edge a point of its covered part. Evaluate a field at these to colour the section.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Segments of the outline in the plane's two coordinates ([`PlaneSection::axes`]), in no particular
    /// order.
    pub fn outline(&self) -> &[[[f64; 2]; 2]] {
        &self.outline
    }

    /// Area of the section, as far as the picture shows it, in squared model units, from chords a fifth of a pixel apart.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// The plane of the section.
    pub fn plane(&self) -> AxisPlane {
        self.plane
    }

    /// The axes that point right and up in the picture.
    pub fn axes(&self) -> [Axis; 2] {
        self.axes
    }

    /// Width and height of the picture in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Side of a pixel, in model units.
    pub fn pixel(&self) -> f64 {
        self.pixel
    }

    /// The coordinates at the left and right (0) or lower and upper (1) edge of the picture.
    pub fn extent(&self, direction: usize) -> (f64, f64) {
        let low = self.corner[direction];
        (low, low + self.pixel * self.size[direction] as f64)
    }

    /// Column and row (the first at the top) of each point's pixel, and the part of it that the section covers.
    pub fn covered_pixels(&self) -> impl Iterator<Item = ([usize; 2], f32)> + '_ {
        let places = self.pixels.iter().map(|p| p.map(|k| k as usize));
        places.zip(self.coverage.iter().copied())
    }

    /// Position in the picture, in pixels from its top left corner, of a point of the plane.
    pub fn on_picture(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        [
            (u - self.corner[0]) / self.pixel,
            self.size[1] as f64 - (v - self.corner[1]) / self.pixel,
        ]
    }

    /// A section not yet filled in, its picture fitted about the box with a small margin.
    fn framed(plane: AxisPlane, axes: [Axis; 2], low: Point, high: Point, size: usize) -> Self {
        let extent = axes.map(|axis| high[axis.index()] - low[axis.index()]);
        let margin = (size / 40).max(2);
        let longer = extent[0].max(extent[1]);
        // A solid without extent in the plane still needs a pixel of some size; it then covers none.
        let pixel = if longer > 1e-300 {
            longer / (size - 2 * margin) as f64
        } else {
            1.0
        };
        let size = extent.map(|e| ((e / pixel).ceil() as usize + 2 * margin).min(size));
        let middle = axes.map(|axis| (low[axis.index()] + high[axis.index()]) / 2.0);
        let corner = [0, 1].map(|k| middle[k] - size[k] as f64 * pixel / 2.0);
        Self {
            plane,
            axes,
            size,
            corner,
            pixel,
            pixels: Vec::new(),
            coverage: Vec::new(),
            points: Vec::new(),
            outline: Vec::new(),
            area: 0.0,
        }
    }

    /// Fills in the covered pixels and their points from the outline.
    fn cover(&mut self) -> Result<(), SectionError> {
        let row_position = |row: usize| self.corner[1] + (row as f64 + 0.5) / SUBROWS as f64 * self.pixel;
        let rows: Vec<f64> = (0..self.size[1] * SUBROWS).map(row_position).collect();
        let mut crossings = crossings(&self.outline, &rows);
        crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut covered_length = 0.0;
        let mut picture_rows: Vec<Vec<(usize, [f64; 2])>> = vec![Vec::new(); self.size[1]];
        for row in crossings.chunk_by(|a, b| a.0 == b.0) {
            let k = row[0].0 as usize;
            let spans = spans(row).ok_or_else(|| {
                let near = self.in_space([row[row.len() - 1].1, rows[k]]);
                let [x, y, z] = near.coords.into();
                SectionError::OpenSurface { x, y, z }
            })?;
            let (left, right) = self.extent(0);
            let length = |[a, b]: &[f64; 2]| (b.min(right) - a.max(left)).max(0.0);
            covered_length += spans.iter().map(length).sum::<f64>();
            picture_rows[k / SUBROWS].extend(spans.into_iter().map(|span| (k % SUBROWS, span)));
        }
        self.area = covered_length * self.pixel / SUBROWS as f64;
        for (from_below, spans) in picture_rows.iter().enumerate().rev() {
            self.cover_row(from_below, spans, &rows[from_below * SUBROWS..]);
        }
        Ok(())
    }

    /// Adds the covered pixels of one row of the picture; `spans` are covered intervals with their row of samples.
    fn cover_row(&mut self, from_below: usize, spans: &[(usize, [f64; 2])], samples: &[f64]) {
        let mut coverage = vec![0.0; self.size[0]];
        // The covered sample nearest to the pixel's centre: squared distance and place.
        let mut nearest = vec![(f64::INFINITY, [0.0; 2]); self.size[0]];
        for &(subrow, [from, to]) in spans {
            let column = |u: f64| ((u - self.corner[0]) / self.pixel).clamp(0.0, self.size[0] as f64 - 1.0) as usize;
            for k in column(from)..=column(to) {
                let left = self.corner[0] + k as f64 * self.pixel;
                let (a, b) = (from.max(left), to.min(left + self.pixel));
                if a >= b {
                    continue;
                }
                coverage[k] += (b - a) / (self.pixel * SUBROWS as f64);
                let (middle, sample) = (left + self.pixel / 2.0, samples[subrow]);
                let u = if a < middle && middle < b {
                    middle
                } else {
                    (a + b) / 2.0
                };
                let distance = (u - middle).powi(2) + (sample - samples[SUBROWS / 2]).powi(2);
                if distance < nearest[k].0 {
                    nearest[k] = (distance, [u, sample]);
                }
            }
        }
        let row = (self.size[1] - 1 - from_below) as u32;
        let covered = coverage
            .into_iter()
            .enumerate()
            .filter(|(_, part)| *part >= LEAST_COVERAGE);
        for (k, part) in covered {
            self.pixels.push([k as u32, row]);
            self.coverage.push(part.min(1.0) as f32);
            self.points.push(self.in_space(nearest[k].1));
        }
    }

    fn in_space(&self, [u, v]: [f64; 2]) -> Point {
        let mut point = Point::origin();
        point[self.plane.axis.index()] = self.plane.position;
        point[self.axes[0].index()] = u;
        point[self.axes[1].index()] = v;
        point
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::mesh::shapes;

    fn section(surface: &SurfaceMesh, axis: Axis, position: f64) -> PlaneSection {
        PlaneSection::new(surface, AxisPlane { axis, position }, Axis::Z, 300).unwrap()
    }

    /// Area of the outline by the shoelace formula, without pixels; its sign follows the orientation of the axes.
    fn polygon_area(section: &PlaneSection) -> f64 {
        let crosses = section.outline().iter().map(|[p, q]| p[0] * q[1] - p[1] * q[0]);
        (crosses.sum::<f64>() / 2.0).abs()
    }

    /// Chords at `h/5` integrate the polygon by the midpoint rule, which errs by at most the variation of the chord
    /// length times `h/10`: twice the width for each of the (at most `bumps`) rises and falls.
    fn assert_area(section: &PlaneSection, exact_polygon: f64, bumps: f64) {
        let width = section.extent(0).1 - section.extent(0).0;
        let bound = bumps * width * section.pixel / SUBROWS as f64;
        assert!(
            (section.area() - exact_polygon).abs() < bound,
            "{} {exact_polygon}",
            section.area()
        );
    }

    #[test]
    fn areas_of_round_solids_are_those_of_the_formulas() {
        // Inscribed triangulations of edge e lose a fraction of the order of e²/8 of the area: 0.2 % and less here.
        let close = |section: &PlaneSection, exact: f64, bumps: f64| {
            assert!(
                (polygon_area(section) / exact - 1.0).abs() < 2e-3,
                "{} {exact}",
                polygon_area(section)
            );
            assert_area(section, polygon_area(section), bumps);
        };
        let ball = shapes::sphere(1.0, 5);
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            close(&section(&ball, axis, 0.6), PI * 0.64, 2.0);
        }
        let torus = shapes::torus(1.0, 0.4, 240, 120);
        close(
            &section(&torus, Axis::Z, 0.0),
            PI * (1.4f64.powi(2) - 0.6f64.powi(2)),
            4.0,
        );
        close(&section(&torus, Axis::Y, 0.0), 2.0 * PI * 0.16, 4.0);
        let shell = shapes::spherical_shell(1.0, 0.5, 5);
        close(&section(&shell, Axis::X, 0.3), PI * 0.75, 4.0);
    }

    #[test]
    fn the_section_of_a_cube_is_exact_even_in_its_faces_and_vertices() {
        for divisions in [1, 4] {
            let cube = shapes::cube(2.0, divisions);
            for axis in [Axis::X, Axis::Y, Axis::Z] {
                for position in [-1.0, -0.5, 0.0, 0.123, 1.0] {
                    let section = section(&cube, axis, position);
                    assert!((polygon_area(&section) - 4.0).abs() < 1e-12, "{axis} {position}");
                    assert_area(&section, 4.0, 2.0);
                }
            }
        }
    }

    #[test]
    fn the_section_at_a_step_is_the_limit_from_the_middle() {
        // A tower of two cubes on a base of three in a row; z = 1 contains the base's upper faces.
        let tower = shapes::polycube(&[[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 1], [1, 0, 2]], 2);
        assert!((polygon_area(&section(&tower, Axis::Z, 1.0)) - 1.0).abs() < 1e-12);
        assert!((polygon_area(&section(&tower, Axis::Z, 0.0)) - 3.0).abs() < 1e-12);
    }

    #[test]
    fn overlapping_parts_count_once_and_inward_oriented_surfaces_are_solid_too() {
        let cube = shapes::cube(2.0, 2);
        let twice = shapes::joined(&cube, &shapes::deformed(&cube, |p| p + crate::Vector::x()));
        assert_area(&section(&twice, Axis::Z, 0.1), 6.0, 2.0);
        assert_area(&section(&cube.reversed(), Axis::Z, 0.1), 4.0, 2.0);
    }

    #[test]
    fn points_lie_in_the_solid_one_for_each_covered_pixel() {
        let shell = shapes::spherical_shell(1.0, 0.5, 4);
        let section = section(&shell, Axis::Y, 0.2);
        // Triangles of edge 1/16 lie at most 1/2048 and some below the sphere; points are exact to rounding.
        for p in section.points() {
            assert_eq!(p.y, 0.2);
            assert!((0.499..1.0).contains(&p.coords.norm()), "{p}");
        }
        let mut places: Vec<[usize; 2]> = section.covered_pixels().map(|(place, _)| place).collect();
        assert_eq!(places.len(), section.points().len());
        for (place, p) in places.iter().zip(section.points()) {
            let drawn = section.on_picture([p.x, p.z]);
            assert!((0..2).all(|k| (drawn[k] - place[k] as f64 - 0.5).abs() < 0.5 + 1e-9));
        }
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), section.points().len());
    }

    #[test]
    fn the_chosen_axis_points_up() {
        let solid = shapes::deformed(&shapes::cube(2.0, 1), |p| Point::new(p.x, 2.0 * p.y, 3.0 * p.z));
        let size = |axis, up| {
            let section = PlaneSection::new(&solid, AxisPlane { axis, position: 0.0 }, up, 300).unwrap();
            (section.axes(), section.size()[1] > section.size()[0])
        };
        assert_eq!(size(Axis::X, Axis::Z), ([Axis::Y, Axis::Z], true));
        assert_eq!(size(Axis::X, Axis::Y), ([Axis::Z, Axis::Y], false));
        assert_eq!(size(Axis::Z, Axis::Y), ([Axis::X, Axis::Y], true));
        assert_eq!(size(Axis::Z, Axis::Z), ([Axis::X, Axis::Y], true));
        assert_eq!(size(Axis::Y, Axis::X), ([Axis::Z, Axis::X], false));
    }

    #[test]
    fn planes_beside_the_solid_are_refused_with_its_extent() {
        let apart = shapes::deformed(&shapes::cube(2.0, 1), |p| p + 5.0 * crate::Vector::z());
        let both = shapes::joined(&shapes::cube(2.0, 1), &apart);
        for position in [-1.01, 2.5, 6.5, f64::NAN] {
            match PlaneSection::new(
                &both,
                AxisPlane {
                    axis: Axis::Z,
                    position,
                },
                Axis::Z,
                100,
            ) {
                Err(SectionError::PlaneMissesSolid { low, high, .. }) => assert_eq!((low, high), (-1.0, 6.0)),
                other => panic!("{position} {other:?}"),
            }
        }
    }

    #[test]
    fn solids_far_away_tiny_or_flat_do_not_panic() {
        let cube = shapes::cube(2.0, 2);
        let scaled = |x: f64, y: f64, z: f64| shapes::deformed(&cube, |p| Point::new(p.x * x, p.y * y, p.z * z));
        for flat in [
            scaled(1.0, 0.0, 1.0),
            scaled(0.0, 0.0, 1.0),
            scaled(5e-324, 5e-324, 1.0),
        ] {
            let plane = AxisPlane {
                axis: Axis::Z,
                position: 0.3,
            };
            assert!(matches!(
                PlaneSection::new(&flat, plane, Axis::Z, 50),
                Err(SectionError::BelowPixel { .. })
            ));
        }
        let far = shapes::deformed(&cube, |p| p + crate::Vector::repeat(1e9));
        assert_area(&section(&far, Axis::Z, 1e9 + 0.3), 4.0, 2.0);
        let large = section(&scaled(1e69, 1e69, 1e69), Axis::Z, 1e68);
        assert!((large.area() / 4e138 - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_touched_vertex_covers_no_pixel() {
        let pole = shapes::deformed(&shapes::cube(2.0, 1), |p| {
            if p.z > 0.0 && p.x > 0.0 && p.y > 0.0 {
                p * 2.0
            } else {
                *p
            }
        });
        let error = PlaneSection::new(
            &pole,
            AxisPlane {
                axis: Axis::Z,
                position: 2.0,
            },
            Axis::Z,
            100,
        )
        .unwrap_err();
        assert!(matches!(error, SectionError::BelowPixel { .. }), "{error}");
    }

    #[test]
    fn open_and_impossible_surfaces_are_refused() {
        let (vertices, mut triangles) = shapes::sphere(1.0, 2).into_parts();
        let middle = AxisPlane {
            axis: Axis::Z,
            position: 0.01,
        };
        // On the left, where the gap is crossed by rows that enter the ball there.
        let cut = |t: &[u32; 3]| {
            let [above, left] = [2, 0].map(|k| t.map(|v| vertices[v as usize][k]));
            above.iter().any(|z| *z > 0.01) && above.iter().any(|z| *z < 0.01) && left.iter().all(|x| *x < -0.5)
        };
        let gap = triangles.iter().position(cut).unwrap();
        triangles.remove(gap);
        let open = SurfaceMesh::new(vertices.clone(), triangles.clone()).unwrap();
        let error = PlaneSection::new(&open, middle, Axis::Z, 100).unwrap_err();
        assert!(matches!(error, SectionError::OpenSurface { .. }), "{error}");

        let mut broken = vertices;
        broken[3].y = f64::NAN;
        let broken = SurfaceMesh::new(broken, triangles).unwrap();
        assert!(matches!(
            PlaneSection::new(&broken, middle, Axis::Z, 100),
            Err(SectionError::NotFinite { vertex: 3 })
        ));
        assert!(matches!(
            PlaneSection::new(&SurfaceMesh::default(), middle, Axis::Z, 100),
            Err(SectionError::EmptySurface)
        ));
        let ball = shapes::sphere(1.0, 2);
        assert!(matches!(
            PlaneSection::new(&ball, middle, Axis::Z, 0),
            Err(SectionError::Pixels { .. })
        ));
        assert!(matches!(
            PlaneSection::new(&ball, middle, Axis::Z, usize::MAX),
            Err(SectionError::Pixels { .. })
        ));
    }
}
