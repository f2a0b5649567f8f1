//! CGAL and TetGen in a worker process, so that their crashes do not end the calling process.
//!
//! On unexpected input both libraries may abort, access invalid memory, or never return. The checks before every call
//! catch the known cases. [`isolate`] handles the rest: calls then go to a worker, which is started when first needed
//! and restarted after a crash.

mod message;
mod serve;

use std::fs::File;
use std::io::{BufReader, BufWriter, ErrorKind, Read, Seek, SeekFrom};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;

use super::CgalTetgenError;
use super::cancellation;
use super::error::CallFailure;

pub use message::Message;
pub use serve::serve_calls;

/// How the worker process is started and limited.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Isolation {
    /// A program that only calls [`serve_calls`] when it is started with `arguments`.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// How long one call may take; after that the worker is killed.
    pub time_limit: Option<Duration>,
}

/// Sends all calls of CGAL and TetGen to a worker process, or with `None`, the default, runs them in this process.
///
/// A worker that crashes gives [`CgalTetgenError::Crashed`], one that takes too long [`CgalTetgenError::TimeLimit`];
/// the next call starts another. Results are bitwise the same as without a worker. Starting takes some 10 ms and each
/// call the time to copy its surface twice; calls wait for one another. A
/// [`SignedDistanceField`](super::SignedDistanceField) belongs to the worker that it was made in and is lost with it
/// ([`CgalTetgenError::Lost`]).
pub fn isolate(isolation: Option<Isolation>) {
    let worker = Mutex::new(None);
    let connection = isolation.map(|isolation| Arc::new(Connection { isolation, worker }));
    *CONNECTION.write().unwrap_or_else(PoisonError::into_inner) = connection;
}

static CONNECTION: RwLock<Option<Arc<Connection>>> = RwLock::new(None);

/// The connection to the worker, if calls are isolated.
pub(super) fn connection() -> Option<Arc<Connection>> {
    CONNECTION.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// The operations of a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Operation {
    /// Makes TetGen fail harmlessly.
    SelfTest = 1,
    /// Tetrahedra by TetGen. Options: largest radius-edge ratio (0 for none), smallest dihedral angle in degrees,
    /// largest volume (0 for none).
    Tetgen,
    /// Tetrahedra by CGAL. Options: the fields of `RefinementSizes`, in their order.
    Mesh3,
    /// A surface around triangles. Options: alpha, offset.
    Wrap,
    /// An isotropically remeshed surface. Options: edge length, angle in degrees of the edges that stay sharp (0 for none).
    Remesh,
    /// Indices of intersecting triangles, two per pair. Option: the number of pairs tested at most.
    Intersections,
    NewField,
    Distance,
    Closest,
    Volume,
    DropField,
}

impl Operation {
    const ALL: [Self; 11] = [
        Self::SelfTest,
        Self::Tetgen,
        Self::Mesh3,
        Self::Wrap,
        Self::Remesh,
        Self::Intersections,
        Self::NewField,
        Self::Distance,
        Self::Closest,
        Self::Volume,
        Self::DropField,
    ];

    fn from_tag(tag: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|operation| *operation as u32 == tag)
    }

    /// Number of options, which precede the coordinates.
    fn option_count(self) -> usize {
        match self {
            Self::Tetgen => 3,
            Self::Mesh3 => 8,
            Self::Wrap | Self::Remesh => 2,
            Self::Intersections => 1,
            _ => 0,
        }
    }

    /// For error messages.
    fn name(self) -> &'static str {
        match self {
            Self::SelfTest => "the self-test of TetGen",
            Self::Tetgen => "TetGen",
            Self::Mesh3 => "CGAL's mesher",
            Self::Wrap => "CGAL's wrapping",
            Self::Remesh => "CGAL's remeshing",
            Self::Intersections => "CGAL's search for self-intersections",
            Self::NewField | Self::Distance | Self::Closest | Self::Volume | Self::DropField => "CGAL's distance query",
        }
    }
}

/// The worker, if it is running, and how to start it.
pub(super) struct Connection {
    isolation: Isolation,
    worker: Mutex<Option<Worker>>,
}

/// Number of workers started so far. Tells the worker of a distance field from later ones.
static STARTED: AtomicU64 = AtomicU64::new(0);

struct Worker {
    id: u64,
    child: Child,
    socket: UnixStream,
    /// Its standard error, if a temporary file could be made.
    stderr: Option<File>,
}

impl Connection {
    /// Runs an operation, on the worker with the id `worker` if one is given. Returns the reply, and the id of the
    /// worker that sent it.
    pub fn call(
        &self,
        operation: Operation,
        worker: Option<u64>,
        mut request: Message,
    ) -> Result<(Message, u64), CgalTetgenError> {
        request.tag = operation as u32;
        let mut running = self.worker.lock().unwrap_or_else(PoisonError::into_inner);
        // A worker that ended between calls, as when the system ran out of memory, is replaced without an error.
        running.take_if(Worker::has_ended);
        if let Some(wanted) = worker
            && running.as_ref().is_none_or(|worker| worker.id != wanted)
        {
            return Err(CgalTetgenError::Lost);
        }
        let worker = match &mut *running {
            Some(worker) => worker,
            empty => empty.insert(Worker::start(&self.isolation)?),
        };
        let limit = self.isolation.time_limit;
        match cancellation::exchange(&worker.socket, || worker.exchange(&request, limit))? {
            Ok(reply) if reply.tag == 0 => Ok((reply, worker.id)),
            Ok(Message { tag, text, .. }) => Err(CallFailure::new(tag as i32, text).into()),
            Err(error) => {
                let late = matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut);
                let ended = running.take().map(|mut worker| worker.end());
                Err(match (late, self.isolation.time_limit, ended) {
                    (true, Some(limit), _) => CgalTetgenError::TimeLimit {
                        operation: operation.name(),
                        seconds: limit.as_secs_f64(),
                    },
                    (_, _, Some((status, stderr))) => crashed(operation, status, &stderr),
                    (_, _, None) => CgalTetgenError::Unknown(error.to_string()),
                })
            }
        }
    }
}

impl Worker {
    fn start(isolation: &Isolation) -> Result<Self, CgalTetgenError> {
        let start = || -> std::io::Result<Self> {
            let (socket, child_socket) = UnixStream::pair()?;
            let stderr = tempfile::tempfile().ok();
            let child_stderr = match &stderr {
                Some(file) => Stdio::from(file.try_clone()?),
                None => Stdio::null(),
            };
            let child = Command::new(&isolation.program)
                .args(&isolation.arguments)
                // One socket for requests and replies: TetGen prints to standard output even when told to be quiet.
                .stdin(Stdio::from(OwnedFd::from(child_socket)))
                .stdout(Stdio::null())
                .stderr(child_stderr)
                .spawn()?;
            Ok(Self {
                id: STARTED.fetch_add(1, Ordering::Relaxed),
                child,
                socket,
                stderr,
            })
        };
        start().map_err(|error| CgalTetgenError::NoWorker {
            program: isolation.program.clone(),
            reason: error.to_string(),
        })
    }

    fn has_ended(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(Some(_)))
    }

    fn exchange(&self, request: &Message, limit: Option<Duration>) -> std::io::Result<Message> {
        // A timeout of zero is an error.
        let limit = limit.map(|limit| limit.max(Duration::from_millis(1)));
        self.socket.set_read_timeout(limit)?;
        self.socket.set_write_timeout(limit)?;
        request.write(&mut BufWriter::new(&self.socket))?;
        Message::read(&mut BufReader::new(&self.socket))
    }

    /// Ends the worker; returns its exit status and standard error.
    fn end(&mut self) -> (Option<ExitStatus>, String) {
        // A worker that closed its socket is about to exit, and its own signal is more informative than SIGKILL.
        let mut status = None;
        for _ in 0..20 {
            status = self.child.try_wait().ok().flatten();
            if status.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        if status.is_none() {
            let _ = self.child.kill();
            status = self.child.wait().ok();
        }
        let mut stderr = Vec::new();
        if let Some(file) = &mut self.stderr {
            let _ = file
                .seek(SeekFrom::Start(0))
                .and_then(|_| file.take(STDERR_LIMIT).read_to_end(&mut stderr));
        }
        (status, String::from_utf8_lossy(&stderr).trim().to_owned())
    }
}

impl Drop for Worker {
    /// Kills and reaps it: an exited process stays in the system's table until it is waited for.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Bytes of a worker's standard error that are read.
const STDERR_LIMIT: u64 = 4096;

fn crashed(operation: Operation, status: Option<ExitStatus>, stderr: &str) -> CgalTetgenError {
    let how = match status.map(|status| (status.signal(), status.code())) {
        Some((Some(signal), _)) => signal_name(signal),
        Some((None, Some(code))) => format!("exit code {code}"),
        _ => "an unknown cause".into(),
    };
    let last = stderr.lines().last().unwrap_or_default();
    CgalTetgenError::Crashed {
        operation: operation.name(),
        how,
        stderr: if last.is_empty() {
            String::new()
        } else {
            format!(" ({last})")
        },
    }
}

/// Names of signals by their numbers on Linux.
fn signal_name(signal: i32) -> String {
    let name = match signal {
        2 => "SIGINT, interrupted",
        4 => "SIGILL, an illegal instruction",
        6 => "SIGABRT, aborted",
        7 => "SIGBUS, a bad memory access",
        8 => "SIGFPE, an arithmetic error",
        9 => "SIGKILL, as when memory runs out",
        11 => "SIGSEGV, an invalid memory access",
        15 => "SIGTERM, terminated",
        24 => "SIGXCPU, out of processor time",
        _ => return format!("signal {signal}"),
    };
    name.into()
}
