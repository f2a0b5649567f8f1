use super::DrawingError;
use super::canvas::{Canvas, INK, Rgb, WHITE, mixed};
use super::colour_map::ColourBar;
use super::number::typeset;
use super::surface_render::{Camera, SurfaceStyle, render};
use solidmap::geometry::PlaneSection;
use solidmap::mesh::SurfaceMesh;

/// Least width and height of a panel, in pixels.
pub(super) const LEAST_SIDE: usize = 16;

/// Least width and height of a mark, in pixels.
const LEAST_MARK: f64 = 14.0;

/// Most pixels of a picture: 8192 × 8192, what common viewers open.
const MOST_PIXELS: usize = 1 << 26;

/// One picture of a [`Figure`](super::Figure): a section, a view of a surface or a histogram, with its texts.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    pub(super) canvas: Canvas,
    pub(super) title: String,
    pub(super) captions: Vec<String>,
    /// Horizontal, then vertical.
    pub(super) axes: Option<[PanelAxis; 2]>,
    pub(super) bar: Option<ColourBar>,
}

/// The coordinate along an edge of a panel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PanelAxis {
    pub(super) name: String,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Panel {
    /// A section coloured by `values`, one for each of [`PlaneSection::points`], with coordinates along its edges and a
    /// caption that names the plane. NaN is drawn grey.
    ///
    /// # Errors
    ///
    /// [`DrawingError::ValueCount`].
    pub fn of_section(section: &PlaneSection, values: &[f64], bar: &ColourBar) -> Result<Self, DrawingError> {
        let colours: Vec<Rgb> = values.iter().map(|&value| bar.colour(value)).collect();
        Self::of_painted_section(section, &colours)
    }

    /// A section in these colours, one for each of [`PlaneSection::points`], with coordinates along its edges and a
    /// caption that names the plane.
    ///
    /// # Errors
    ///
    /// [`DrawingError::ValueCount`].
    pub fn of_painted_section(section: &PlaneSection, colours: &[Rgb]) -> Result<Self, DrawingError> {
        check_count("section point", section.points().len(), colours.len())?;
        let [width, height] = section.size();
        let mut canvas = Canvas::new(width, height, WHITE);
        for (([x, y], coverage), colour) in section.covered_pixels().zip(colours) {
            canvas.set(x, y, mixed(WHITE, *colour, coverage));
        }
        let outline: Vec<_> = section
            .outline()
            .iter()
            .map(|s| s.map(|p| section.on_picture(p)))
            .collect();
        canvas.stroke(&outline, (width.max(height) as f64 / 400.0).max(1.2), INK);

        let plane = section.plane();
        let axes = [0, 1].map(|direction| {
            let (low, high) = section.extent(direction);
            PanelAxis {
                name: section.axes()[direction].to_string(),
                low,
                high,
            }
        });
        Ok(Self {
            canvas,
            title: String::new(),
            captions: vec![format!("section {} = {}", plane.axis, typeset(plane.position, 4))],
            axes: Some(axes),
            bar: None,
        })
    }

    /// A shaded view of a surface, fitted into `width × height` pixels.
    ///
    /// # Errors
    ///
    /// [`DrawingError::EmptySurface`], [`DrawingError::NotFinite`], [`DrawingError::ValueCount`],
    /// [`DrawingError::TooSmall`] and [`DrawingError::TooLarge`].
    pub fn of_surface(
        surface: &SurfaceMesh,
        style: &SurfaceStyle,
        camera: &Camera,
        [width, height]: [usize; 2],
    ) -> Result<Self, DrawingError> {
        check_size(width, height)?;
        Ok(Self::of_canvas(render(surface, style, camera, [width, height])?))
    }

    pub(super) fn of_canvas(canvas: Canvas) -> Self {
        Self {
            canvas,
            title: String::new(),
            captions: Vec::new(),
            axes: None,
            bar: None,
        }
    }

    /// The same panel, turned by 180° if `upside_down`: its coordinates then fall to the right and upwards.
    pub fn turned_if(mut self, upside_down: bool) -> Self {
        if upside_down {
            self.canvas.turn();
            for axis in self.axes.iter_mut().flatten() {
                std::mem::swap(&mut axis.low, &mut axis.high);
            }
        }
        self
    }

    /// The same panel under this title.
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// The same panel with one more line of caption.
    pub fn captioned(mut self, caption: impl Into<String>) -> Self {
        self.captions.push(caption.into());
        self
    }

    /// The same panel with a rectangle drawn around what lies between two corners, in pixels from the top left corner of
    /// the picture; at least `LEAST_MARK` pixels wide and high, so that it is seen.
    pub fn marked(mut self, [a, b]: [[f64; 2]; 2]) -> Self {
        let ends = [0, 1].map(|k| {
            let (middle, half) = ((a[k] + b[k]) / 2.0, ((b[k] - a[k]).abs() / 2.0).max(LEAST_MARK / 2.0));
            [middle - half, middle + half]
        });
        let corner = |i: usize, j: usize| [ends[0][i], ends[1][j]];
        let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
        let sides: Vec<_> = (0..4).map(|k| [corners[k], corners[(k + 1) % 4]]).collect();
        let width = (self.canvas.width().max(self.canvas.height()) as f64 / 300.0).max(1.6);
        self.canvas.stroke(&sides, width, INK);
        self
    }

    /// The same panel with a colour bar of its own.
    pub fn with_bar(mut self, bar: &ColourBar) -> Self {
        self.bar = Some(bar.clone());
        self
    }
}

/// Refuses panels too small to see and pictures too large to hold.
pub(super) fn check_size(width: usize, height: usize) -> Result<(), DrawingError> {
    if width < LEAST_SIDE || height < LEAST_SIDE {
        return Err(DrawingError::TooSmall { least: LEAST_SIDE });
    }
    if width.saturating_mul(height) > MOST_PIXELS {
        let limit = MOST_PIXELS;
        return Err(DrawingError::TooLarge { width, height, limit });
    }
    Ok(())
}

pub(super) fn check_count(element: &'static str, expected: usize, found: usize) -> Result<(), DrawingError> {
    if found == expected {
        Ok(())
    } else {
        Err(DrawingError::ValueCount {
            element,
            expected,
            found,
        })
    }
}
