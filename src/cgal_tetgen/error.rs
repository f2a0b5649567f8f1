use std::path::PathBuf;

use crate::memory::readable;
use crate::mesh::MeshError;

/// Why a surface cannot be used for an operation, with the place of the first defect (indices 0-based).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputDefect {
    /// No triangles at all.
    #[error("it has no triangles")]
    Empty,
    /// A NaN or infinite coordinate.
    #[error("vertex {vertex} has a coordinate that is NaN or infinite")]
    NotFinite {
        /// The first such vertex.
        vertex: usize,
    },
    /// Coordinates whose products overflow or underflow.
    #[error("its size of {size:e} is outside 1e-30 to 1e30; choose another unit of length")]
    OutOfScale {
        /// Largest coordinate, or the box's diagonal.
        size: f64,
    },
    /// A triangle with a repeated vertex or collinear corners.
    #[error("triangle {triangle} has no area; merge its corners or remove it and repair the neighbours")]
    DegenerateTriangle {
        /// The first such triangle.
        triangle: usize,
    },
    /// Two triangles with the same corners, in any order.
    #[error("triangles {first} and {second} have the same corners; remove one of them, or both where sheets cancel")]
    RepeatedTriangle {
        /// The lower index.
        first: usize,
        /// The higher index.
        second: usize,
    },
    /// Two vertices in one place.
    #[error("vertices {first} and {second} are in the same place; merge them")]
    CoincidentVertices {
        /// The lower index.
        first: usize,
        /// The higher index.
        second: usize,
    },
    /// A vertex that no triangle uses; a tetrahedral mesh could not keep it.
    #[error("vertex {vertex} belongs to no triangle; remove the vertices that nothing uses")]
    UnreferencedVertex {
        /// The first such vertex.
        vertex: usize,
    },
    /// Edges shared by an odd number of triangles.
    #[error(
        "it is open: {edges} edges, the first between vertices {} and {}, have an odd number of triangles; close it",
        edge[0], edge[1]
    )]
    Open {
        /// The first such edge.
        edge: [u32; 2],
        /// How many there are.
        edges: usize,
    },
    /// An edge of more than two triangles, where the operation needs a manifold.
    #[error("the edge between vertices {} and {} has {triangles} triangles; split the surface there", edge[0], edge[1])]
    NonManifoldEdge {
        /// The edge.
        edge: [u32; 2],
        /// How many triangles meet in it.
        triangles: usize,
    },
    /// A component that cannot be oriented consistently, or is non-manifold and not consistently oriented.
    #[error(
        "the triangles at the edge between vertices {} and {} are not oriented consistently, and it is not clear how \
         to orient them; orient them outward",
        edge[0], edge[1]
    )]
    NotOrientable {
        /// An edge where they disagree.
        edge: [u32; 2],
    },
    /// A closed surface without volume.
    #[error("it encloses no volume: all of it lies in a plane, or its sheets cancel")]
    Flat,
}

/// Why an operation of CGAL or TetGen failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CgalTetgenError {
    /// The surface does not fulfil the operation's requirements.
    #[error("the surface cannot be used: {0}")]
    InvalidInput(#[from] InputDefect),
    /// An option outside its range.
    #[error("option `{name}` is {value}, but it must be {requirement}")]
    InvalidOption {
        /// Field of the options.
        name: &'static str,
        /// What was asked for.
        value: f64,
        /// What is allowed.
        requirement: &'static str,
    },
    /// Triangles of the surface intersect.
    #[error(
        "the surface intersects itself: {pairs} pairs of triangles, the first {} and {}; repair it or mesh a wrap of \
         it",
        first[0], first[1]
    )]
    SelfIntersection {
        /// How many pairs intersect.
        pairs: usize,
        /// The first of them.
        first: [u32; 2],
    },
    /// More pairs of triangles have overlapping boxes than can be tested.
    #[error("too many triangles lie close together to test all pairs of them; {pairs} of the pairs tested intersect")]
    Crowded {
        /// Intersecting pairs found so far.
        pairs: usize,
    },
    /// TetGen met triangles that intersect within its tolerance.
    #[error(
        "TetGen finds triangles that intersect within its tolerance; remesh the surface where it nearly touches itself"
    )]
    NearIntersection,
    /// TetGen met a feature too small to resolve.
    #[error("TetGen finds a feature too small to mesh; remove very short edges and very thin triangles")]
    SmallFeature,
    /// TetGen met two triangles that nearly coincide.
    #[error("TetGen finds two triangles that nearly coincide; move them apart or merge them")]
    CloseFacets,
    /// Memory ran out.
    #[error("memory ran out; ask for a coarser mesh")]
    OutOfMemory,
    /// An internal error of TetGen, by its own code.
    #[error("TetGen failed with its code {code}; remesh the surface, or use the other mesher")]
    Internal {
        /// TetGen's code: 2 for an internal error, 10 for rejected input.
        code: i32,
    },
    /// A mesher returned no tetrahedra.
    #[error("the mesher returned no tetrahedra; check that the surface is closed and larger than the sizes asked for")]
    EmptyResult,
    /// The sizes asked for would take too many elements.
    #[error("about {elements:.1e} {kind} would be needed, more than {limit:.1e}; ask for a coarser mesh")]
    TooFine {
        /// `"triangles"` or `"tetrahedra"`.
        kind: &'static str,
        /// The estimate.
        elements: f64,
        /// How many are accepted.
        limit: f64,
    },
    /// More memory than allowed.
    #[error(
        "about {} of memory would be needed, and {} are allowed; ask for a coarser mesh, or allow more",
        readable(*need), readable(*allowed)
    )]
    TooLarge {
        /// Bytes that are needed, by an estimate.
        need: u64,
        /// Bytes that are allowed.
        allowed: u64,
    },
    /// The tetrahedra do not fill the surface.
    #[error("the tetrahedra fill a volume of {got:e}, but the surface encloses {want:e}; the result was rejected")]
    VolumeMismatch {
        /// Volume of the tetrahedra.
        got: f64,
        /// Volume that the surface encloses.
        want: f64,
    },
    /// The boundary of a boundary-preserving mesh differs from the input.
    #[error("the mesher changed the boundary at triangle {triangle}; vertices may lie too close together there")]
    BoundaryChanged {
        /// The first input triangle that is not a face of the boundary, or the number of input triangles when none is
        /// at fault.
        triangle: usize,
    },
    /// A boundary-preserving mesh does not begin with the input's vertices.
    #[error("the mesher moved or merged vertex {vertex}; it may lie too close to another")]
    VertexChanged {
        /// The first such vertex.
        vertex: usize,
    },
    /// A tetrahedron has no volume in double precision.
    #[error("tetrahedron {tet} of the result is flat in double precision; remesh the surface, or ask for more quality")]
    FlatTetrahedron {
        /// The first such tetrahedron.
        tet: usize,
    },
    /// No offset surface had the genus asked for.
    #[error(
        "the offset surface has genus {got}, not {want}; gaps below twice `alpha` are filled, so lower it or the \
         distance"
    )]
    Topology {
        /// Genus of the finest wrap.
        got: usize,
        /// Genus asked for.
        want: usize,
    },
    /// No offset surface passed its checks.
    #[error("no offset surface after {attempts} attempts: {reason}; choose a larger distance or `max_triangles`")]
    OffsetFailed {
        /// How many wraps were tried.
        attempts: usize,
        /// Why the last was rejected.
        reason: String,
    },
    /// An exception of CGAL.
    #[error("CGAL failed: {0}")]
    Cgal(String),
    /// TetGen's errors would end the process, so it is not called.
    #[error(
        "TetGen cannot be called safely in this process: {0}; load solidmap before other libraries that use TetGen"
    )]
    SelfTestFailed(String),
    /// CGAL's mesher was stopped early.
    #[error(
        "meshing was stopped because {0}; ask for a coarser mesh, raise the limit, or remove parts that nearly touch"
    )]
    Stopped(String),
    /// The worker process crashed; see [`isolate`](super::isolate).
    #[error(
        "{operation} crashed in its own process: {how}{stderr}; remesh the surface, or remove parts that nearly touch"
    )]
    Crashed {
        /// The operation.
        operation: &'static str,
        /// The signal's name, or the exit code.
        how: String,
        /// The last line that it wrote to standard error, in brackets, or nothing.
        stderr: String,
    },
    /// A call took longer than [`Isolation::time_limit`](super::Isolation).
    #[error("{operation} was not done within the time limit of {seconds} s; ask for a coarser mesh, or for more time")]
    TimeLimit {
        /// The operation.
        operation: &'static str,
        /// The limit.
        seconds: f64,
    },
    /// The worker that held a [`SignedDistanceField`](super::SignedDistanceField) has ended.
    #[error("the process that held the distance field has ended; make the field again")]
    Lost,
    /// The worker process could not be started.
    #[error("`{}` could not be started for CGAL and TetGen: {reason}", program.display())]
    NoWorker {
        /// The program.
        program: PathBuf,
        /// The system's message.
        reason: String,
    },
    /// A progress callback cancelled the call; see [`cancellable`](super::cancellable).
    #[error("cancelled by the progress callback")]
    Cancelled,
    /// An error that has no other variant.
    #[error("the C++ side failed: {0}")]
    Unknown(String),
    /// The result has more elements than indices can name.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl CgalTetgenError {
    /// Whether no further call is of use: the worker is gone with everything it held, or calls are cancelled.
    pub(super) fn is_final(&self) -> bool {
        matches!(
            self,
            Self::Crashed { .. } | Self::TimeLimit { .. } | Self::NoWorker { .. } | Self::Lost | Self::Cancelled
        )
    }
}

/// `kUnknown` of `src/cgal_tetgen/cpp/core.h`.
const CODE_UNKNOWN: i32 = 103;

/// A failed call, with a code of `src/cgal_tetgen/cpp/core.h`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CallFailure {
    pub code: i32,
    pub message: String,
}

impl CallFailure {
    pub fn new(code: i32, message: String) -> Self {
        Self { code, message }
    }

    pub fn unknown(message: &str) -> Self {
        Self::new(CODE_UNKNOWN, message.into())
    }
}

impl From<CallFailure> for CgalTetgenError {
    fn from(CallFailure { code, message }: CallFailure) -> Self {
        match code {
            1 => Self::OutOfMemory,
            2 | 10 => Self::Internal { code },
            3 => Self::NearIntersection,
            4 => Self::SmallFeature,
            5 => Self::CloseFacets,
            101 => Self::Cgal(message),
            104 => Self::Stopped(message),
            105 => Self::Crowded {
                pairs: message.parse().unwrap_or_default(),
            },
            102 => Self::SelfTestFailed(message),
            _ => Self::Unknown(message),
        }
    }
}
