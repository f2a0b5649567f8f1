//! Plane sections of solids on a grid of pixels.
//!
//! Each triangle that the plane crosses gives a directed segment of the outline; along a row of the grid the segments
//! crossed so far give the winding number, and the solid is where it is not zero. Cavities, several components and
//! components that overlap need no special case.

use std::fmt;

use super::ReportError;
use super::panel::check_size;
use crate::Point;
use crate::mesh::SurfaceMesh;

/// Rows of coverage samples in a pixel. Odd, so that one of them passes through the pixel's centre.
const SUBROWS: usize = 5;

/// Pixels that are covered less do not show.
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

/// A plane perpendicular to a coordinate axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// The axis it is perpendicular to.
    pub axis: Axis,
    /// Where it meets the axis, in model units.
    pub position: f64,
}

/// A plane section of a solid: the pixels that it covers, a point of the solid in each, and its outline.
///
/// The picture frames the whole solid as seen along the axis, not the section alone, so that sections of one solid at
/// different positions can be laid side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    plane: Plane,
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

/// Where the outline crosses a row of samples: row, position along it, change of the winding number.
type Crossing = (u32, f64, i32);

impl Section {
    /// The section of the solid that `surface` bounds, `size` pixels along the longer side of the picture, with z
    /// pointing up in it, and y when the plane is perpendicular to z.
    ///
    /// # Errors
    ///
    /// As [`Section::with_up`].
    pub fn new(surface: &SurfaceMesh, plane: Plane, size: usize) -> Result<Self, ReportError> {
        Self::with_up(surface, plane, Axis::Z, size)
    }

    /// The section with the axis `up` pointing up in the picture; where that is perpendicular to the plane, the later
    /// of the two others does.
    ///
    /// Where the plane passes through vertices or contains triangles, the section is the limit of those on the side
    /// of the solid's middle: a plane through an outer face of a cube gives the whole face. Costs a pass over the
    /// triangles and memory for the covered pixels.
    ///
    /// # Errors
    ///
    /// [`ReportError::PlaneMissesSolid`], [`ReportError::SectionBelowPixel`], [`ReportError::OpenSurface`] when the
    /// outline does not close, [`ReportError::NotFinite`], [`ReportError::EmptySurface`], [`ReportError::TooSmall`]
    /// and [`ReportError::TooLarge`].
    pub fn with_up(surface: &SurfaceMesh, plane: Plane, up: Axis, size: usize) -> Result<Self, ReportError> {
        check_size(size, size)?;
        let (low, high) = finite_box(surface)?;
        let along = plane.axis.index();
        let misses = || ReportError::PlaneMissesSolid {
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
        let mut section = Self::framed(plane, axes, low, high, size);
        section.outline = outline;
        section.cover()?;
        if section.points.is_empty() {
            return Err(ReportError::SectionBelowPixel {
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

    /// Segments of the outline in the plane's two coordinates ([`Section::axes`]), in no order.
    pub fn outline(&self) -> &[[[f64; 2]; 2]] {
        &self.outline
    }

    /// Area of the section in squared model units, from chords a fifth of a pixel apart.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// The plane of the section.
    pub fn plane(&self) -> Plane {
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

    /// The coordinates at the left and right (0) or lower and upper (1) edge of the picture.
    pub(super) fn extent(&self, direction: usize) -> (f64, f64) {
        let low = self.corner[direction];
        (low, low + self.pixel * self.size[direction] as f64)
    }

    /// Column and row, the first at the top, of each point's pixel, and what part of it the section covers.
    pub(super) fn covered_pixels(&self) -> impl Iterator<Item = ([usize; 2], f32)> + '_ {
        let places = self.pixels.iter().map(|p| p.map(|k| k as usize));
        places.zip(self.coverage.iter().copied())
    }

    /// Position in the picture, in pixels from its top left corner, of a point of the plane.
    pub(super) fn on_picture(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        [
            (u - self.corner[0]) / self.pixel,
            self.size[1] as f64 - (v - self.corner[1]) / self.pixel,
        ]
    }

    /// A section not yet filled in, its picture fitted about the box with a small margin.
    fn framed(plane: Plane, axes: [Axis; 2], low: Point, high: Point, size: usize) -> Self {
        let extent = axes.map(|axis| high[axis.index()] - low[axis.index()]);
        let margin = (size / 40).max(2);
        let longer = extent[0].max(extent[1]);
        // A solid without extent in the plane still needs a pixel of some size; it then covers none.
        let pixel = if longer > 0.0 {
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
    fn cover(&mut self) -> Result<(), ReportError> {
        let rows: Vec<f64> = (0..self.size[1] * SUBROWS).map(|k| self.row_position(k)).collect();
        let mut crossings = crossings(&self.outline, &rows);
        crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut covered_length = 0.0;
        let mut picture_rows: Vec<Vec<(usize, [f64; 2])>> = vec![Vec::new(); self.size[1]];
        for row in crossings.chunk_by(|a, b| a.0 == b.0) {
            let k = row[0].0 as usize;
            let spans = spans(row).ok_or_else(|| self.gap_near(row[row.len() - 1], rows[k]))?;
            covered_length += spans.iter().map(|[a, b]| b - a).sum::<f64>();
            picture_rows[k / SUBROWS].extend(spans.into_iter().map(|span| (k % SUBROWS, span)));
        }
        self.area = covered_length * self.pixel / SUBROWS as f64;
        for (from_below, spans) in picture_rows.iter().enumerate().rev() {
            self.cover_row(from_below, spans, &rows[from_below * SUBROWS..]);
        }
        Ok(())
    }

    fn row_position(&self, subrow: usize) -> f64 {
        self.corner[1] + (subrow as f64 + 0.5) / SUBROWS as f64 * self.pixel
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
                let centre = [left + self.pixel / 2.0, samples[SUBROWS / 2]];
                let u = if a < centre[0] && centre[0] < b {
                    centre[0]
                } else {
                    (a + b) / 2.0
                };
                let distance = (u - centre[0]).powi(2) + (samples[subrow] - centre[1]).powi(2);
                if distance < nearest[k].0 {
                    nearest[k] = (distance, [u, samples[subrow]]);
                }
            }
        }
        let row = (self.size[1] - 1 - from_below) as u32;
        for (k, part) in coverage
            .into_iter()
            .enumerate()
            .filter(|(_, part)| *part >= LEAST_COVERAGE)
        {
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

    fn gap_near(&self, crossing: Crossing, v: f64) -> ReportError {
        let near = self.in_space([crossing.1, v]);
        ReportError::OpenSurface {
            x: near.x,
            y: near.y,
            z: near.z,
        }
    }
}

/// The bounding box of the vertices that triangles use, all of them finite and far from overflow.
pub(super) fn finite_box(surface: &SurfaceMesh) -> Result<(Point, Point), ReportError> {
    const LARGEST: f64 = 1e150;
    let mut bounds: Option<(Point, Point)> = None;
    for &vertex in surface.triangles().iter().flatten() {
        let p = surface.vertices()[vertex as usize];
        if p.iter().any(|c| c.is_nan() || c.abs() > LARGEST) {
            let vertex = vertex as usize;
            return Err(ReportError::NotFinite { vertex });
        }
        let (low, high) = bounds.get_or_insert((p, p));
        *low = low.inf(&p);
        *high = high.sup(&p);
    }
    bounds.ok_or(ReportError::EmptySurface)
}

/// The directed segments in which the plane cuts the triangles. Each crossed edge gives the same point, to the last
/// bit, in both of its triangles, so that the outline of a closed surface is closed.
fn outline(surface: &SurfaceMesh, plane: Plane, axes: [Axis; 2], on_plane_is_above: bool) -> Vec<[[f64; 2]; 2]> {
    let along = plane.axis.index();
    let above = |v: u32| {
        let height = surface.vertices()[v as usize][along];
        height > plane.position || (on_plane_is_above && height == plane.position)
    };
    let crossing = |a: u32, b: u32| {
        let [p, q] = [a.min(b), a.max(b)].map(|v| surface.vertices()[v as usize]);
        let t = (plane.position - p[along]) / (q[along] - p[along]);
        axes.map(|k| p[k.index()] + t * (q[k.index()] - p[k.index()]))
    };
    let mut segments = Vec::new();
    for &[a, b, c] in surface.triangles() {
        let sides = [above(a), above(b), above(c)];
        if sides[0] == sides[1] && sides[1] == sides[2] {
            continue;
        }
        let mut ends = [[0.0; 2]; 2];
        for (from, to, [is, becomes]) in [
            (a, b, [sides[0], sides[1]]),
            (b, c, [sides[1], sides[2]]),
            (c, a, [sides[2], sides[0]]),
        ] {
            if is != becomes {
                ends[usize::from(becomes)] = crossing(from, to);
            }
        }
        segments.push(ends);
    }
    segments
}

/// Where the segments cross the rows, at the heights `rows` in ascending order. A segment holds its lower end and not
/// its upper one, so that a vertex on a row counts once.
fn crossings(outline: &[[[f64; 2]; 2]], rows: &[f64]) -> Vec<Crossing> {
    let mut crossings = Vec::new();
    for &[start, end] in outline {
        let (p, q, turn) = if start[1] <= end[1] {
            (start, end, 1)
        } else {
            (end, start, -1)
        };
        let first = rows.partition_point(|v| *v < p[1]);
        let last = rows.partition_point(|v| *v < q[1]);
        crossings.extend((first..last).map(|row| {
            let t = (rows[row] - p[1]) / (q[1] - p[1]);
            (row as u32, p[0] + t * (q[0] - p[0]), turn)
        }));
    }
    crossings
}

/// The intervals of a row with a winding number that is not zero; `None` when it does not return to zero.
fn spans(row: &[Crossing]) -> Option<Vec<[f64; 2]>> {
    let mut spans = Vec::new();
    let (mut winding, mut entered) = (0, 0.0);
    for &(_, u, turn) in row {
        if winding == 0 {
            entered = u;
        }
        winding += turn;
        if winding == 0 && u > entered {
            spans.push([entered, u]);
        }
    }
    (winding == 0).then_some(spans)
}
