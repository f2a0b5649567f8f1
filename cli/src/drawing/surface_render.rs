//! Shaded views of surfaces: an orthographic camera, a depth buffer, and lights that come with the camera.

use rayon::prelude::*;

use super::DrawingError;
use super::canvas::{Canvas, Rgb};
use super::checker::{Checker, Pattern};
use super::colour_map::ColourBar;
use super::light::{lighting, to_linear, to_srgb};
use super::panel::check_count;
use solidmap::geometry::Axis;
use solidmap::mesh::SurfaceMesh;
use solidmap::{Point, Vector};

/// Samples along each side of a pixel.
const SAMPLES: usize = 3;

/// Rows of pixels drawn as one task: bounds the memory for samples, and makes enough tasks for all threads.
const BAND: usize = 32;

/// Part of the picture left free on each side.
const MARGIN: f64 = 0.05;

/// Background at the top and bottom of the picture.
const BACKGROUND: [Rgb; 2] = [[250, 251, 252], [228, 231, 236]];

/// Where a surface is seen from: an orthographic view of its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// By how far the viewer goes to the right about the upward axis, in degrees. At 0 the view is from the front:
    /// along +y when z is up, along −z when y is up.
    pub azimuth: f64,
    /// Height above the horizon, in degrees; 90 looks straight down.
    pub elevation: f64,
    /// The axis that points up.
    pub up: Axis,
    /// Whether it points down instead: the surface is first rotated by 180° about the front view's direction.
    pub upside_down: bool,
}

impl Default for Camera {
    /// From the front, the right and above, z up.
    fn default() -> Self {
        Self {
            azimuth: 32.0,
            elevation: 24.0,
            up: Axis::Z,
            upside_down: false,
        }
    }
}

impl Camera {
    /// The unit vector from what is seen to the viewer.
    pub fn towards_viewer(&self) -> Vector {
        self.frame()[2]
    }

    /// Unit vectors to the right and upwards in the picture, and towards the viewer.
    fn frame(&self) -> [Vector; 3] {
        let [right, up, front] = match self.up {
            Axis::X => [Vector::y(), Vector::x(), -Vector::z()],
            Axis::Y => [Vector::x(), Vector::y(), Vector::z()],
            Axis::Z => [Vector::x(), Vector::z(), -Vector::y()],
        };
        let [right, up] = if self.upside_down { [-right, -up] } else { [right, up] };
        let (sin, cos) = self.azimuth.to_radians().sin_cos();
        let (rise, reach) = self.elevation.to_radians().sin_cos();
        let level = front * cos + right * sin;
        let viewer = level * reach + up * rise;
        let across = right * cos - front * sin;
        [across, viewer.cross(&across), viewer]
    }
}

/// How light falls on the triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Shading {
    /// Every triangle by its own plane.
    Flat,
    /// Rounded over edges of less than 40°; sharper ones, such as a polycube's, stay sharp.
    #[default]
    Smooth,
}

/// Which edges of the triangles are drawn. They fade where triangles are only a few pixels large.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Edges {
    /// None.
    #[default]
    Hidden,
    /// All.
    All,
    /// For each triangle `[a, b, c]` whether `ab`, `bc` and `ca` are drawn: leaves out the diagonals of quadrilaterals.
    Marked(Vec<[bool; 3]>),
}

/// What colours a surface.
#[derive(Debug, Clone, PartialEq)]
pub enum SurfaceColour {
    /// One colour.
    Uniform(Rgb),
    /// A value at each vertex, interpolated before it is coloured.
    PerVertex(Vec<f64>, ColourBar),
    /// A value of each triangle.
    PerTriangle(Vec<f64>, ColourBar),
    /// A colour at each corner of each triangle, mixed between them as light.
    PerCorner(Vec<[Rgb; 3]>),
    /// A pattern in space, evaluated between the vertices.
    Checker(Checker),
}

/// How a surface looks. The default is plain light clay, shaded smoothly, without edges.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceStyle {
    /// What colours it.
    pub colour: SurfaceColour,
    /// How light falls on it.
    pub shading: Shading,
    /// Which edges show.
    pub edges: Edges,
}

impl Default for SurfaceStyle {
    fn default() -> Self {
        Self {
            colour: SurfaceColour::Uniform([224, 217, 206]),
            shading: Shading::default(),
            edges: Edges::default(),
        }
    }
}

/// A triangle ready to be drawn: corners in samples (depth towards the viewer), normals in the camera's frame.
struct Face {
    corners: [Vector; 3],
    normals: [Vector; 3],
    /// What the corners are coloured by: a value in the first coordinate, a place in a pattern, or linear light.
    places: [Point; 3],
    edges: [bool; 3],
}

/// How samples are coloured.
enum Paint<'a> {
    Plain(Rgb),
    Bar(&'a ColourBar),
    Pattern(&'a Pattern),
    /// Places are colours, in linear light.
    Light,
}

/// What is common to all faces.
struct Scene<'a> {
    faces: Vec<Face>,
    paint: Paint<'a>,
    edge_opacity: f32,
    edge_half_width: f64,
}

/// The view of a surface; sizes have been checked.
pub(super) fn render(
    surface: &SurfaceMesh,
    style: &SurfaceStyle,
    camera: &Camera,
    [width, height]: [usize; 2],
) -> Result<Canvas, DrawingError> {
    check_surface(surface)?;
    check_style(surface, style)?;
    let scene = scene(surface, style, camera, [width, height]);
    let mut canvas = Canvas::new(width, height, BACKGROUND[0]);
    canvas
        .pixels_mut()
        .par_chunks_mut(width * BAND)
        .enumerate()
        .for_each(|(band, pixels)| {
            draw_band(&scene, band * BAND, width, height, pixels);
        });
    Ok(canvas)
}

fn check_surface(surface: &SurfaceMesh) -> Result<(), DrawingError> {
    const LARGEST: f64 = 1e70; // Squared areas stay finite.
    let is_bad = |vertex: u32| {
        let p = surface.vertices()[vertex as usize];
        p.iter().any(|c| c.is_nan() || c.abs() > LARGEST)
    };
    let bad = surface
        .triangles()
        .iter()
        .flatten()
        .copied()
        .find(|&vertex| is_bad(vertex));
    match bad {
        Some(vertex) => Err(DrawingError::NotFinite {
            vertex: vertex as usize,
        }),
        None if surface.triangles().is_empty() => Err(DrawingError::EmptySurface),
        None => Ok(()),
    }
}

fn check_style(surface: &SurfaceMesh, style: &SurfaceStyle) -> Result<(), DrawingError> {
    match &style.colour {
        SurfaceColour::Uniform(_) => {}
        SurfaceColour::PerVertex(values, _) => check_count("vertex", surface.vertices().len(), values.len())?,
        SurfaceColour::PerTriangle(values, _) => check_count("triangle", surface.triangles().len(), values.len())?,
        SurfaceColour::PerCorner(colours) => check_count("triangle", surface.triangles().len(), colours.len())?,
        SurfaceColour::Checker(checker) => check_count("vertex", surface.vertices().len(), checker.places.len())?,
    }
    match &style.edges {
        Edges::Marked(marks) => check_count("triangle", surface.triangles().len(), marks.len()),
        _ => Ok(()),
    }
}

fn scene<'a>(surface: &SurfaceMesh, style: &'a SurfaceStyle, camera: &Camera, size: [usize; 2]) -> Scene<'a> {
    let frame = camera.frame();
    let seen = |v: &Vector| Vector::new(v.dot(&frame[0]), v.dot(&frame[1]), v.dot(&frame[2]));
    let positions = on_samples(surface, seen, size);
    let normals = corner_normals(surface, style.shading);
    let faces: Vec<Face> = (surface.triangles().iter().zip(normals).enumerate())
        .map(|(t, (&triangle, normals))| Face {
            corners: triangle.map(|v| positions[v as usize]),
            normals: normals.map(|n| seen(&n)),
            places: match &style.colour {
                SurfaceColour::Uniform(_) => [Point::origin(); 3],
                SurfaceColour::PerVertex(values, _) => triangle.map(|v| Point::new(values[v as usize], 0.0, 0.0)),
                SurfaceColour::PerTriangle(values, _) => [Point::new(values[t], 0.0, 0.0); 3],
                SurfaceColour::PerCorner(colours) => {
                    colours[t].map(|rgb| Point::from(rgb.map(|c| f64::from(to_linear(c)))))
                }
                SurfaceColour::Checker(checker) => triangle.map(|v| checker.places[v as usize]),
            },
            edges: match &style.edges {
                Edges::Hidden => [false; 3],
                Edges::All => [true; 3],
                Edges::Marked(marks) => marks[t],
            },
        })
        .collect();
    let paint = match &style.colour {
        SurfaceColour::Uniform(colour) => Paint::Plain(*colour),
        SurfaceColour::PerVertex(_, bar) | SurfaceColour::PerTriangle(_, bar) => Paint::Bar(bar),
        SurfaceColour::PerCorner(_) => Paint::Light,
        SurfaceColour::Checker(checker) => Paint::Pattern(&checker.pattern),
    };
    let edge_width = (size[0].max(size[1]) as f64 / 700.0).max(0.9);
    Scene {
        edge_opacity: edge_opacity(&faces, edge_width),
        edge_half_width: edge_width * SAMPLES as f64 / 2.0,
        faces,
        paint,
    }
}

/// The vertices in the picture, in samples: x to the right, y downwards, z towards the viewer.
fn on_samples(surface: &SurfaceMesh, seen: impl Fn(&Vector) -> Vector, size: [usize; 2]) -> Vec<Vector> {
    // Relative to a vertex: far from the origin, rotated coordinates would lose digits.
    let first = surface.triangles()[0][0] as usize;
    let origin = surface.vertices()[first];
    let turned: Vec<Vector> = surface.vertices().iter().map(|p| seen(&(p - origin))).collect();
    let used = || surface.triangles().iter().flatten().map(|&v| turned[v as usize]);
    let (low, high) = used().fold((turned[first], turned[first]), |(l, h), p| (l.inf(&p), h.sup(&p)));
    let extent = high - low;
    let room = size.map(|s| s as f64 * SAMPLES as f64 * (1.0 - 2.0 * MARGIN));
    let scale = (room[0] / extent.x).min(room[1] / extent.y);
    // A point or a line seen end on has no extent; any scale shows it.
    let scale = if scale.is_finite() { scale } else { 1.0 };
    let middle = size.map(|s| s as f64 * SAMPLES as f64 / 2.0);
    let centre = (low + high) / 2.0;
    let place = |p: &Vector| {
        let q = (p - centre) * scale;
        Vector::new(middle[0] + q.x, middle[1] - q.y, q.z)
    };
    turned.iter().map(place).collect()
}

/// Unit normals at the corners of each triangle; zero for triangles without area.
fn corner_normals(surface: &SurfaceMesh, shading: Shading) -> Vec<[Vector; 3]> {
    const CREASE_COSINE: f64 = 0.766; // 40°
    let areas: Vec<Vector> = (0..surface.triangles().len()).map(|t| surface.area_vector(t)).collect();
    let units: Vec<Vector> = areas.iter().map(|a| a.try_normalize(0.0).unwrap_or_default()).collect();
    if shading == Shading::Flat {
        return units.iter().map(|n| [*n; 3]).collect();
    }
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); surface.vertices().len()];
    for (t, triangle) in surface.triangles().iter().enumerate() {
        triangle.iter().for_each(|&v| around[v as usize].push(t as u32));
    }
    let normal = |t: usize, v: u32| {
        let near = around[v as usize].iter().map(|&o| o as usize);
        let sum: Vector = near
            .filter(|&o| units[o].dot(&units[t]) > CREASE_COSINE)
            .map(|o| areas[o])
            .sum();
        sum.try_normalize(0.0).unwrap_or(units[t])
    };
    let triangles = surface.triangles().iter().enumerate();
    triangles.map(|(t, triangle)| triangle.map(|v| normal(t, v))).collect()
}

/// The opacity of edges. It falls with the mean edge length in pixels: else edges of dense meshes would cover the
/// surface.
fn edge_opacity(faces: &[Face], edge_width: f64) -> f32 {
    let lengths = faces.iter().map(|f| (f.corners[1] - f.corners[0]).xy().norm());
    let mean = lengths.sum::<f64>() / faces.len() as f64 / SAMPLES as f64;
    (0.75 * ((mean / edge_width - 2.0) / 8.0).clamp(0.0, 1.0)) as f32
}

/// Draws the rows of pixels from `first_row` on that `pixels` holds.
fn draw_band(scene: &Scene, first_row: usize, width: usize, height: usize, pixels: &mut [Rgb]) {
    let rows = pixels.len() / width;
    let (columns, lines) = (width * SAMPLES, rows * SAMPLES);
    let top = (first_row * SAMPLES) as f64;
    let mut depth = vec![f64::NEG_INFINITY; columns * lines];
    let mut light = vec![[f32::NAN; 3]; columns * lines];
    for face in &scene.faces {
        draw_face(scene, face, top, [columns, lines], &mut depth, &mut light);
    }
    for (k, pixel) in pixels.iter_mut().enumerate() {
        let (x, y) = (k % width, k / width);
        let background = background((first_row + y) as f64 / height as f64);
        let mut sum = [0f32; 3];
        for sample in 0..SAMPLES * SAMPLES {
            let place = (y * SAMPLES + sample / SAMPLES) * columns + x * SAMPLES + sample % SAMPLES;
            let colour = if depth[place] > f64::NEG_INFINITY {
                light[place]
            } else {
                background
            };
            sum.iter_mut().zip(colour).for_each(|(s, c)| *s += c);
        }
        *pixel = sum.map(|s| to_srgb(s / (SAMPLES * SAMPLES) as f32));
    }
}

fn background(depth: f64) -> [f32; 3] {
    let [top, bottom] = BACKGROUND.map(|colour| colour.map(to_linear));
    [0, 1, 2].map(|k| top[k] + (bottom[k] - top[k]) * depth as f32)
}

/// Draws a face into the samples of a band whose first line is `top`.
fn draw_face(
    scene: &Scene,
    face: &Face,
    top: f64,
    [columns, lines]: [usize; 2],
    depth: &mut [f64],
    light: &mut [[f32; 3]],
) {
    let [a, b, c] = face.corners;
    let low = a.inf(&b).inf(&c);
    let high = a.sup(&b).sup(&c);
    if high.y < top || low.y > top + lines as f64 {
        return;
    }
    let cross = |u: Vector, v: Vector| u.x * v.y - u.y * v.x;
    let doubled_area = cross(b - a, c - a);
    if doubled_area == 0.0 {
        return;
    }
    // The picture's y points down, so triangles that face the viewer turn the other way.
    let faces_viewer = doubled_area < 0.0;
    let heights = [(b - a), (c - b), (a - c)].map(|e| doubled_area.abs() / e.xy().norm().max(f64::MIN_POSITIVE));
    let range = |low: f64, high: f64, count: usize| {
        let bounded = |x: f64| x.clamp(0.0, count as f64) as usize;
        bounded((low - 0.5).ceil())..bounded((high + 0.5).floor())
    };
    for line in range(low.y - top, high.y - top, lines) {
        for column in range(low.x, high.x, columns) {
            let p = Vector::new(column as f64 + 0.5, top + line as f64 + 0.5, 0.0);
            let weights = [cross(b - p, c - p), cross(c - p, a - p), cross(a - p, b - p)].map(|w| w / doubled_area);
            if weights.iter().any(|w| *w < 0.0) {
                continue;
            }
            let place = line * columns + column;
            let z = weights[0] * a.z + weights[1] * b.z + weights[2] * c.z;
            if z > depth[place] {
                depth[place] = z;
                // Edge k joins corners k and k + 1; the corner opposite to it measures the distance.
                let on_edge =
                    (0..3).any(|k| face.edges[k] && weights[(k + 2) % 3] * heights[k] < scene.edge_half_width);
                light[place] = shaded(scene, face, weights, faces_viewer, on_edge);
            }
        }
    }
}

/// Linear light of a sample.
fn shaded(scene: &Scene, face: &Face, weights: [f64; 3], faces_viewer: bool, on_edge: bool) -> [f32; 3] {
    const EDGE: Rgb = [38, 44, 56];
    // The inside of an open surface, greyed so that it is not taken for the outside.
    const INSIDE: Rgb = [120, 112, 108];
    let mixed = |of: [Vector; 3]| of[0] * weights[0] + of[1] * weights[1] + of[2] * weights[2];
    let normal = mixed(face.normals).try_normalize(0.0).unwrap_or_default();
    let place: Vector = (0..3).map(|k| face.places[k].coords * weights[k]).sum();
    let (normal, albedo) = match &scene.paint {
        _ if !faces_viewer => (-normal, INSIDE),
        Paint::Plain(colour) => (normal, *colour),
        Paint::Bar(bar) => (normal, bar.colour(place.x)),
        Paint::Pattern(pattern) => (normal, pattern.colour(&place.into())),
        Paint::Light => (normal, [0, 1, 2].map(|k| to_srgb(place[k] as f32))),
    };
    let (diffuse, gloss) = lighting(&normal, !matches!(scene.paint, Paint::Plain(_)));
    let opacity = if on_edge { scene.edge_opacity } else { 0.0 };
    [0, 1, 2].map(|k| {
        let surface = to_linear(albedo[k]) * diffuse[k] + gloss;
        surface + (to_linear(EDGE[k]) - surface) * opacity
    })
}

#[cfg(test)]
mod tests {
    use super::super::colour_map::{Colours, Scale, ValueRange};
    use super::*;
    use solidmap::mesh::shapes;

    const FRONT: Camera = Camera {
        azimuth: 0.0,
        elevation: 0.0,
        up: Axis::Z,
        upside_down: false,
    };

    fn background_at(y: usize, height: usize) -> Rgb {
        background(y as f64 / height as f64).map(to_srgb)
    }

    /// Pixels that differ from the background.
    fn covered(canvas: &Canvas) -> Vec<(usize, usize)> {
        let places = (0..canvas.height()).flat_map(|y| (0..canvas.width()).map(move |x| (x, y)));
        places
            .filter(|&(x, y)| canvas.get(x, y) != background_at(y, canvas.height()))
            .collect()
    }

    #[test]
    fn every_camera_is_a_right_handed_frame() {
        for up in [Axis::X, Axis::Y, Axis::Z] {
            for (azimuth, elevation) in [(0.0, 0.0), (32.0, 24.0), (-100.0, 90.0)] {
                for upside_down in [false, true] {
                    let camera = Camera {
                        azimuth,
                        elevation,
                        up,
                        upside_down,
                    };
                    let [right, upward, viewer] = camera.frame();
                    assert!((right.cross(&upward) - viewer).norm() < 1e-15);
                    assert!((right.norm() - 1.0).abs() < 1e-15 && right[up.index()].abs() < 1e-15);
                    assert!(elevation == 90.0 || (upward[up.index()] < 0.0) == upside_down);
                }
            }
        }
    }

    /// The disc has 0.9 of the width as its diameter; pixels on its rim, π · 180 long, count whole.
    #[test]
    fn a_ball_fills_its_disc() {
        let canvas = render(&shapes::sphere(3.0, 4), &SurfaceStyle::default(), &FRONT, [200, 240]).unwrap();
        let exact = std::f64::consts::PI * 90.0 * 90.0;
        assert!((covered(&canvas).len() as f64 - exact).abs() < std::f64::consts::PI * 180.0);
    }

    #[test]
    fn the_nearer_surface_hides_the_farther_in_either_order() {
        let near = shapes::deformed(&shapes::cube(1.0, 1), |p| p - 3.0 * Vector::y());
        let far = shapes::cube(1.0, 1);
        let bar = ColourBar::new("part", [0.0, 1.0], ValueRange::Full, Scale::Linear).unwrap();
        let bar = bar.in_colours(Colours::Rainbow);
        for (first, second, values) in [(&near, &far, [1.0, 0.0]), (&far, &near, [0.0, 1.0])] {
            let count = first.triangles().len();
            let values = values.iter().flat_map(|v| std::iter::repeat_n(*v, count)).collect();
            let style = SurfaceStyle {
                colour: SurfaceColour::PerTriangle(values, bar.clone()),
                ..SurfaceStyle::default()
            };
            let canvas = render(&shapes::joined(first, second), &style, &FRONT, [50, 50]).unwrap();
            let [red, green, blue] = canvas.get(25, 25);
            assert!(red > 150 && green == 0 && blue == 0);
        }
    }

    #[test]
    fn a_vertex_field_runs_from_left_to_right() {
        let cube = shapes::cube(1.0, 2);
        let bar = ColourBar::new("x", [-0.5, 0.5], ValueRange::Full, Scale::Linear).unwrap();
        let bar = bar.in_colours(Colours::Rainbow);
        let values = cube.vertices().iter().map(|p| p.x).collect();
        let style = SurfaceStyle {
            colour: SurfaceColour::PerVertex(values, bar),
            ..SurfaceStyle::default()
        };
        let canvas = render(&cube, &style, &FRONT, [100, 100]).unwrap();
        let [left, middle, right] = [8, 50, 91].map(|x| canvas.get(x, 50));
        assert!(left[2] > 150 && left[0] == 0 && right[0] > 150 && right[2] == 0);
        assert!(middle[1] > 150 && middle[0] < 40 && middle[2] < 40, "{middle:?}");
    }

    /// Two triangles make a face of the cube: cells of a twentieth are far smaller.
    #[test]
    fn a_checker_is_sharp_inside_of_triangles() {
        let cube = shapes::cube(1.0, 1);
        let (low, high) = cube.bounding_box().unwrap();
        let places = cube.vertices().to_vec();
        let pattern = Pattern::Cubes { low, high, cells: 20 };
        let style = SurfaceStyle {
            colour: SurfaceColour::Checker(Checker { places, pattern }),
            ..SurfaceStyle::default()
        };
        let canvas = render(&cube, &style, &FRONT, [400, 400]).unwrap();
        let blue = |x: usize| i32::from(canvas.get(x, 203)[2]);
        let jumps = (30..370).filter(|&x| (blue(x) - blue(x - 2)).abs() > 30).count();
        // 340 of 360 pixels of 20 cells have 18 or 19 borders, each of which two pairs of pixels see.
        assert!((34..=40).contains(&jumps), "{jumps}");
        let wrong = SurfaceStyle {
            colour: SurfaceColour::Checker(Checker {
                places: vec![],
                pattern,
            }),
            ..SurfaceStyle::default()
        };
        assert!(matches!(
            render(&cube, &wrong, &FRONT, [30, 30]),
            Err(DrawingError::ValueCount { .. })
        ));
    }

    #[test]
    fn edges_are_drawn_where_marked() {
        let cube = shapes::cube(1.0, 1);
        let diagonals_hidden = cube.triangles().iter().map(|&[a, b, c]| {
            [[a, b], [b, c], [c, a]].map(|[p, q]| {
                let along = cube.vertices()[q as usize] - cube.vertices()[p as usize];
                along.norm() < 1.1
            })
        });
        let view = |edges| {
            let style = SurfaceStyle {
                edges,
                ..SurfaceStyle::default()
            };
            render(&cube, &style, &FRONT, [101, 101]).unwrap()
        };
        let marked = view(Edges::Marked(diagonals_hidden.collect()));
        let (plain, all) = (view(Edges::Hidden), view(Edges::All));
        // The centre of the front face lies on its diagonal, (5, 50) on its left side.
        assert_eq!(marked.get(50, 50), plain.get(50, 50));
        assert!(all.get(50, 50)[0] + 40 < plain.get(50, 50)[0]);
        assert!(marked.get(5, 50)[0] + 40 < plain.get(5, 50)[0]);
    }

    #[test]
    fn smooth_shading_rounds_a_ball_and_keeps_a_cube_sharp() {
        let ball = shapes::sphere(1.0, 3);
        for (normals, triangle) in corner_normals(&ball, Shading::Smooth).iter().zip(ball.triangles()) {
            for (normal, &v) in normals.iter().zip(triangle) {
                // Edges of 1/8: the averaged normal is off by far less than the 1/16 of a single triangle's.
                assert!((normal - ball.vertices()[v as usize].coords).norm() < 0.02);
            }
        }
        let cube = shapes::cube(1.0, 2);
        assert_eq!(
            corner_normals(&cube, Shading::Smooth),
            corner_normals(&cube, Shading::Flat)
        );
    }

    #[test]
    fn degenerate_surfaces_are_drawn_or_refused_but_never_panic() {
        let ball = shapes::sphere(1.0, 1);
        let flat = shapes::deformed(&ball, |_| solidmap::Point::new(1.0, 2.0, 3.0));
        let canvas = render(&flat, &SurfaceStyle::default(), &FRONT, [30, 30]).unwrap();
        assert!(covered(&canvas).is_empty());
        let style = SurfaceStyle {
            edges: Edges::Marked(vec![[true; 3]]),
            ..SurfaceStyle::default()
        };
        assert!(matches!(
            render(&ball, &style, &FRONT, [30, 30]),
            Err(DrawingError::ValueCount { .. })
        ));
    }
}
