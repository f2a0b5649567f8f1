//! CGAL and TetGen in a process of their own, so that their end is not that of the process that calls them.
//!
//! Both libraries end a process where they meet what they do not expect: by an assertion, by memory that is not theirs,
//! or by never coming back. The checks before every call keep out what is known to do so. [`isolate`] keeps out the rest:
//! from then on calls go to a worker, which is started when it is first needed and again after it ended.

mod frame;
mod serve;

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::Duration;

use super::CgalTetgenError;
use super::error::Failed;

pub use frame::Frame;
pub use serve::serve_calls;

/// How calls of CGAL and TetGen leave this process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Isolation {
    /// A program that calls [`serve_calls`] and nothing else, when it is started with these arguments.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// How long one call may take; the worker is ended when it takes longer.
    pub time_limit: Option<Duration>,
}

/// Sends all calls of CGAL and TetGen from this process to a worker, or with `None` keeps them here, as they are at first.
///
/// A worker that ends gives [`CgalTetgenError::Crashed`], one that takes too long [`CgalTetgenError::TimeLimit`]; the next call
/// starts another, as it does when one has ended in between. Results are the same bit by bit. Starting takes some 10 ms and
/// each call the time to copy its surface twice; calls wait for one another. A
/// [`SignedDistanceField`](super::SignedDistanceField) lives where it was made and ends with it, [`CgalTetgenError::Lost`].
pub fn isolate(isolation: Option<Isolation>) {
    let line = isolation.map(|isolation| {
        Arc::new(Line {
            isolation,
            worker: Mutex::new(None),
        })
    });
    *LINE.write().unwrap_or_else(PoisonError::into_inner) = line;
}

static LINE: RwLock<Option<Arc<Line>>> = RwLock::new(None);

/// The line to the worker, where there is to be one.
pub(super) fn line() -> Option<Arc<Line>> {
    LINE.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// What is asked of a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Operation {
    SelfTest = 1,
    Tetgen,
    Mesh3,
    Wrap,
    Remesh,
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

    fn of_tag(tag: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|operation| *operation as u32 == tag)
    }

    /// How many numbers stand before the coordinates.
    fn options(self) -> usize {
        match self {
            Self::Tetgen => 3,
            Self::Mesh3 => 8,
            Self::Wrap => 2,
            Self::Remesh | Self::Intersections => 1,
            _ => 0,
        }
    }

    /// What is being done, for messages.
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

/// A worker that is or will be, and how to start it.
pub(super) struct Line {
    isolation: Isolation,
    worker: Mutex<Option<Worker>>,
}

/// Workers started so far; a field is of one of them.
static STARTED: AtomicU64 = AtomicU64::new(0);

struct Worker {
    number: u64,
    child: Child,
    socket: UnixStream,
    /// What it writes to its standard error, where there is a folder for such files.
    said: Option<File>,
}

impl Line {
    /// Has something done. `worker` names the worker that has to do it, where that matters.
    pub fn call(
        &self,
        operation: Operation,
        worker: Option<u64>,
        mut request: Frame,
    ) -> Result<Answer, CgalTetgenError> {
        request.tag = operation as u32;
        let mut held = self.hold();
        // One that ended while nobody asked, as when the system wanted its memory, has failed no call.
        held.take_if(Worker::has_ended);
        if let Some(wanted) = worker
            && held.as_ref().is_none_or(|worker| worker.number != wanted)
        {
            return Err(CgalTetgenError::Lost);
        }
        let worker = match &mut *held {
            Some(worker) => worker,
            empty => empty.insert(Worker::start(&self.isolation)?),
        };
        match worker.exchange(&request, self.isolation.time_limit) {
            Ok(frame) => {
                let worker = worker.number;
                match frame.tag as i32 {
                    0 => Ok(Answer { frame, worker }),
                    code => Err(Failed {
                        code,
                        message: frame.text,
                    }
                    .into()),
                }
            }
            Err(error) => {
                let late = matches!(
                    error.kind(),
                    std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
                );
                let ended = held.take().map(|mut worker| worker.end());
                Err(match (late, self.isolation.time_limit, ended) {
                    (true, Some(limit), _) => CgalTetgenError::TimeLimit {
                        operation: operation.name(),
                        seconds: limit.as_secs_f64(),
                    },
                    (_, _, Some((status, said))) => crashed(operation, status, &said),
                    (_, _, None) => CgalTetgenError::Unknown(error.to_string()),
                })
            }
        }
    }

    /// Takes away a field of a worker, if that is still there; there is nobody to tell when it is not.
    pub fn drop_field(&self, worker: u64, field: u32) {
        let request = Frame {
            integers: vec![field],
            ..Frame::default()
        };
        let _ = self.call(Operation::DropField, Some(worker), request);
    }

    fn hold(&self) -> MutexGuard<'_, Option<Worker>> {
        self.worker.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What a worker has answered.
pub(super) struct Answer {
    pub frame: Frame,
    /// Which one it was.
    pub worker: u64,
}

impl Worker {
    fn start(isolation: &Isolation) -> Result<Self, CgalTetgenError> {
        let start = || -> std::io::Result<Self> {
            let (socket, theirs) = UnixStream::pair()?;
            let said = tempfile::tempfile().ok();
            let their_words = match &said {
                Some(said) => Stdio::from(said.try_clone()?),
                None => Stdio::null(),
            };
            let child = Command::new(&isolation.program)
                .args(&isolation.arguments)
                // Both ways over one socket: TetGen prints to standard output whatever it is told.
                .stdin(Stdio::from(OwnedFd::from(theirs)))
                .stdout(Stdio::null())
                .stderr(their_words)
                .spawn()?;
            Ok(Self {
                number: STARTED.fetch_add(1, Ordering::Relaxed),
                child,
                socket,
                said,
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

    fn exchange(&mut self, request: &Frame, limit: Option<Duration>) -> std::io::Result<Frame> {
        // A limit of nothing would mean none at all.
        let limit = limit.map(|limit| limit.max(Duration::from_millis(1)));
        self.socket.set_read_timeout(limit)?;
        self.socket.set_write_timeout(limit)?;
        request.write(&mut BufWriter::new(&self.socket))?;
        Frame::read(&mut BufReader::new(&self.socket))
    }

    /// Ends it, and says how it ended and what it said.
    fn end(&mut self) -> (Option<ExitStatus>, String) {
        // One that closed its line is about to end by itself, and its own signal tells more than ours.
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
        let mut said = Vec::new();
        if let Some(file) = &mut self.said {
            let _ = file
                .seek(SeekFrom::Start(0))
                .and_then(|_| file.take(MOST_WORDS).read_to_end(&mut said));
        }
        (status, String::from_utf8_lossy(&said).trim().to_owned())
    }
}

impl Drop for Worker {
    /// The system keeps what is left of a process until somebody asks how it ended.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Bytes of a worker's words that are kept.
const MOST_WORDS: u64 = 4096;

fn crashed(operation: Operation, status: Option<ExitStatus>, said: &str) -> CgalTetgenError {
    let how = match status.map(|status| (status.signal(), status.code())) {
        Some((Some(signal), _)) => signal_name(signal),
        Some((None, Some(code))) => format!("exit code {code}"),
        _ => "an unknown end".into(),
    };
    let last = said.lines().last().unwrap_or_default();
    CgalTetgenError::Crashed {
        operation: operation.name(),
        how,
        said: if last.is_empty() {
            String::new()
        } else {
            format!(" ({last})")
        },
    }
}

/// Signals that end a process, by their numbers on Linux.
fn signal_name(signal: i32) -> String {
    let name = match signal {
        2 => "SIGINT, interrupted",
        4 => "SIGILL, an illegal instruction",
        6 => "SIGABRT, given up by itself",
        7 => "SIGBUS, memory that is not there",
        8 => "SIGFPE, an illegal division",
        9 => "SIGKILL, as the system does when memory runs out",
        11 => "SIGSEGV, memory that is not its own",
        15 => "SIGTERM, ended from outside",
        24 => "SIGXCPU, too much processor time",
        _ => return format!("signal {signal}"),
    };
    name.into()
}
