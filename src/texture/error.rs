use crate::boundary_map::BoundaryMapError;
use crate::fit::FitError;
use crate::geometry::QueryError;

/// Why there is no solid texture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TextureError {
    /// A picture has no pixels, or a number of them that does not match its size.
    #[error(
        "a picture of {width} × {height} pixels was given {pixels} pixels; it needs width × height, and at least \
         one"
    )]
    PictureSize {
        /// Pixels from left to right.
        width: usize,
        /// Pixels from top to bottom.
        height: usize,
        /// Pixels given.
        pixels: usize,
    },
    /// A checkerboard of no squares or of too many.
    #[error("a checkerboard has 1 to 1024 squares along a side, not {squares}")]
    CheckerSquares {
        /// Squares asked for.
        squares: usize,
    },
    /// The number of texture coordinates is not that of the triangles.
    #[error("the surface has {triangles} triangles, but texture coordinates were given for {found}")]
    UvCount {
        /// Triangles of the surface.
        triangles: usize,
        /// Triangles that coordinates were given for.
        found: usize,
    },
    /// A texture coordinate is NaN or infinite.
    #[error("triangle {triangle} (0-based) has a texture coordinate that is not finite; export the coordinates again")]
    UvNotFinite {
        /// The first such triangle.
        triangle: usize,
    },
    /// The number of colours is not that of the vertices.
    #[error("the surface has {vertices} vertices, but {found} colours were given")]
    ColourCount {
        /// Vertices of the surface.
        vertices: usize,
        /// Colours given.
        found: usize,
    },
    /// A colour is NaN or infinite.
    #[error("the colour of vertex {vertex} (0-based) is not finite")]
    ColourNotFinite {
        /// The first such vertex.
        vertex: usize,
    },
    /// Texture coordinates were to be extended, but there are none.
    #[error(
        "the surface has colours at its vertices and no texture coordinates that could be extended; extend the colours"
    )]
    NoUv,
    /// Texture coordinates jump at seams, and have no smooth extension.
    #[error(
        "the texture coordinates jump at {seams} of {edges} edges, by up to {jump:.3}; the extension would squeeze all \
         of the picture in between into the gap between the two sides. Extend the colours instead, or allow this"
    )]
    Seams {
        /// Edges at which they jump.
        seams: usize,
        /// All edges.
        edges: usize,
        /// The largest jump.
        jump: f64,
    },
    /// More sources were asked for than are allowed.
    #[error("at least {least} sources were asked for, but at most {most} are allowed; ask for fewer, or allow more")]
    SourceLimit {
        /// Sources at least.
        least: usize,
        /// Sources at most.
        most: usize,
    },
    /// The number of sources asked for needs more memory than allowed.
    #[error("{sources} sources or more need about {need:.1} GiB, and {allowed:.1} GiB are allowed; ask for fewer")]
    TooManySources {
        /// Sources at least.
        sources: usize,
        /// Memory that they need, in GiB.
        need: f64,
        /// Memory that they may take, in GiB.
        allowed: f64,
    },
    /// A volume of no voxels.
    #[error("a volume needs at least one voxel along its longest side")]
    NoVoxels,
    /// The volume would not fit into memory.
    #[error(
        "a volume of {} × {} × {} voxels needs about {need:.1} GiB, and {allowed:.1} GiB are allowed; ask for fewer \
         voxels",
        size[0], size[1], size[2]
    )]
    TooLarge {
        /// Voxels along x, y and z.
        size: [usize; 3],
        /// Memory that it takes, in GiB.
        need: f64,
        /// Memory that it may take, in GiB.
        allowed: f64,
    },
    /// A stored texture is inconsistent.
    #[error("the texture is inconsistent: {problem}")]
    Inconsistent {
        /// What contradicts what.
        problem: String,
    },
    /// The surface cannot be queried.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The boundary values cannot be used.
    #[error(transparent)]
    BoundaryMap(#[from] BoundaryMapError),
    /// The harmonic function could not be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
}
