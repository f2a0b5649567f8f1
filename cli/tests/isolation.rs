//! CGAL and TetGen in a process of their own: the same results, and an error when that process ends.
#![cfg(feature = "native")]

use std::cell::Cell;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use solidmap::Point;
use solidmap::cgal_tetgen::{
    CgalTetgenError, Isolation, Mesh3Options, OffsetOptions, SignedDistanceField, TetOptions, cancellable, isolate,
    offset_surface, self_intersections, self_test, tetrahedralize, tetrahedralize_mesh3,
};
use solidmap::io;
use solidmap::mesh::{SurfaceMesh, shapes};

/// Isolation is a setting of the whole process: one test at a time.
static TURN: Mutex<()> = Mutex::new(());

fn turn() -> MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

fn solidmap() -> PathBuf {
    assert_cmd::cargo::cargo_bin("solidmap")
}

fn isolated(time_limit: Option<Duration>) {
    isolate(Some(Isolation {
        program: solidmap(),
        arguments: vec!["native-worker".into()],
        time_limit,
    }));
}

/// A mesh that takes TetGen seconds.
fn long_work() -> (SurfaceMesh, TetOptions) {
    let options = TetOptions {
        max_volume: Some(1e-6),
        ..TetOptions::default()
    };
    (shapes::sphere(1.0, 4), options)
}

/// Processes that another one has started.
fn children(parent: u32) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let is_child = |pid: &u32| {
        let status = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        // The name in brackets may hold anything.
        let rest = status.rsplit_once(") ").map_or("", |(_, rest)| rest);
        let mut rest = rest.split(' ');
        rest.next() != Some("Z") && rest.next() == Some(&parent.to_string())
    };
    pids.filter(is_child).collect()
}

/// Ends the worker of a process as soon as there is one and it has worked for a while.
fn kill_worker(of: u32, signal: &str) {
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(20) {
        if let Some(worker) = children(of).first() {
            std::thread::sleep(Duration::from_millis(300));
            let killed = Command::new("kill").args([signal, &worker.to_string()]).status();
            assert!(killed.unwrap().success());
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("no worker was started");
}

#[test]
fn a_worker_gives_the_same_bits() {
    let _turn = turn();
    let ball = shapes::sphere(1.0, 3);
    let crossing = shapes::joined(
        &ball,
        &shapes::deformed(&ball, |p| p + solidmap::Vector::new(0.8, 0.1, 0.2)),
    );
    let points: Vec<Point> = (0..2000)
        .map(|k| {
            Point::new(
                (f64::from(k) * 0.618).fract() * 3.0 - 1.5,
                f64::from(k) * 1e-3 - 1.0,
                0.1,
            )
        })
        .chain([Point::new(f64::NAN, 0.0, 0.0)])
        .collect();
    let all = || {
        self_test().unwrap();
        let field = SignedDistanceField::new(&ball).unwrap();
        let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
        (
            tetrahedralize(&ball, &TetOptions::default()).unwrap(),
            tetrahedralize_mesh3(&shapes::cube(1.0, 2), &Mesh3Options::default()).unwrap(),
            offset_surface(&ball, 0.2, &OffsetOptions::default()).unwrap(),
            self_intersections(&crossing).unwrap(),
            tetrahedralize(&crossing, &TetOptions::default()).unwrap_err(),
            bits(field.distance(&points)),
            bits(
                field
                    .closest_points(&points)
                    .iter()
                    .flat_map(|p| [p.x, p.y, p.z])
                    .collect(),
            ),
            field.volume().unwrap(),
        )
    };
    isolate(None);
    let here = all();
    isolated(None);
    let there = all();
    isolate(None);
    assert_eq!(here, there);
    assert!(!here.3.is_empty() && matches!(here.4, CgalTetgenError::SelfIntersection { .. }));
}

#[test]
fn the_end_of_a_worker_is_an_error_and_the_next_call_has_another() {
    let _turn = turn();
    let (ball, options) = long_work();
    isolated(None);
    let field = SignedDistanceField::new(&ball).unwrap();
    assert!((field.distance(&[Point::origin()])[0] + 1.0).abs() < 0.01);
    let own = std::process::id();
    let killer = std::thread::spawn(move || kill_worker(own, "-ABRT"));
    let error = tetrahedralize(&ball, &options)
        .map(|mesh| mesh.tets().len())
        .unwrap_err();
    killer.join().unwrap();
    assert!(
        error
            .to_string()
            .starts_with("TetGen crashed in its own process: SIGABRT"),
        "{error}"
    );
    // What the worker held is lost, and its use is an error; new calls have a new worker.
    assert!(field.distance(&[Point::origin()])[0].is_nan());
    assert!(field.volume().is_err());
    assert!(tetrahedralize(&shapes::cube(1.0, 2), &TetOptions::default()).is_ok());
    assert!(SignedDistanceField::new(&ball).unwrap().volume().unwrap() > 4.0);
    isolate(None);
}

#[test]
fn a_worker_that_ended_between_calls_is_replaced() {
    let _turn = turn();
    let ball = shapes::sphere(1.0, 3);
    isolated(None);
    let field = SignedDistanceField::new(&ball).unwrap();
    kill_worker(std::process::id(), "-KILL");
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(field.volume(), Err(CgalTetgenError::Lost));
    assert!(tetrahedralize(&ball, &TetOptions::default()).is_ok());
    isolate(None);
}

/// Rust programs ignore SIGPIPE; a C++ program with this library does not, and would be killed by it.
#[test]
fn writing_to_a_worker_that_has_gone_sends_no_signal() {
    unsafe extern "C" {
        fn signal(number: i32, handler: usize) -> usize;
    }
    const SIGPIPE: i32 = 13;
    const DEFAULT: usize = 0;
    let _turn = turn();
    // SAFETY: the C library's function, with its default handler.
    let before = unsafe { signal(SIGPIPE, DEFAULT) };
    isolate(Some(Isolation {
        program: "/bin/false".into(),
        arguments: Vec::new(),
        time_limit: Some(Duration::from_secs(10)),
    }));
    // More than the socket holds, so that some of it is written after the worker has ended.
    let error = self_intersections(&shapes::sphere(1.0, 6)).unwrap_err();
    assert!(error.to_string().contains("exit code 1"), "{error}");
    isolate(None);
    // SAFETY: as above, and the handler is the one there was.
    unsafe { signal(SIGPIPE, before) };
}

#[test]
fn a_call_ends_at_its_time_limit() {
    let _turn = turn();
    let (ball, options) = long_work();
    isolated(Some(Duration::from_millis(300)));
    let begun = Instant::now();
    let error = tetrahedralize(&ball, &options)
        .map(|mesh| mesh.tets().len())
        .unwrap_err();
    assert!(
        matches!(error, CgalTetgenError::TimeLimit { seconds: 0.3, .. }),
        "{error}"
    );
    // Not a measure of speed: without the limit it takes several times as long, and may never end.
    assert!(begun.elapsed() < Duration::from_secs(5));
    assert!(children(std::process::id()).is_empty(), "the worker is gone");
    assert!(tetrahedralize(&shapes::cube(1.0, 2), &TetOptions::default()).is_ok());
    isolate(None);
}

/// Cancels a long run of TetGen after a few calls of the callback.
fn cancelled_tetgen() {
    let (ball, options) = long_work();
    let calls = Cell::new(0);
    let progress = || {
        calls.set(calls.get() + 1);
        if calls.get() > 3 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    };
    let ended = cancellable(&progress, move || tetrahedralize(&ball, &options));
    assert_eq!(ended.map(|mesh| mesh.tets().len()), Err(CgalTetgenError::Cancelled));
    assert_eq!(calls.get(), 4);
}

#[test]
fn a_cancelled_call_ends_its_worker() {
    let _turn = turn();
    isolated(None);
    let begun = Instant::now();
    cancelled_tetgen();
    // Not a measure of speed: the thread that waited for the worker ends it.
    while !children(std::process::id()).is_empty() {
        assert!(begun.elapsed() < Duration::from_secs(5), "the worker goes on");
        std::thread::sleep(Duration::from_millis(10));
    }
    let cube = shapes::cube(1.0, 2);
    let made = cancellable(&|| (), move || tetrahedralize(&cube, &TetOptions::default()));
    assert!(made.is_ok());
    isolate(None);
}

#[test]
fn a_cancelled_call_in_this_process_is_left_behind() {
    let _turn = turn();
    isolate(None);
    cancelled_tetgen();
    let ball = shapes::sphere(1.0, 3);
    assert!(offset_surface(&ball, 0.2, &OffsetOptions::default()).is_ok());
    // This one waits for the other to end.
    assert!(tetrahedralize(&ball, &TetOptions::default()).is_ok());
}

#[test]
fn a_program_that_cannot_serve_is_named() {
    let _turn = turn();
    for (program, arguments, said) in [
        ("/no/such/program", vec![], "`/no/such/program` could not be started"),
        ("/bin/false", vec![], "exit code 1"),
        // One that answers nothing that could be understood.
        ("/bin/sh", vec!["-c", "echo nonsense >&0; exit 3"], "exit code 3"),
    ] {
        isolate(Some(Isolation {
            program: program.into(),
            arguments: arguments.into_iter().map(String::from).collect(),
            time_limit: Some(Duration::from_secs(10)),
        }));
        let error = self_intersections(&shapes::sphere(1.0, 1)).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
    isolate(None);
}

#[test]
fn a_crash_ends_a_command_with_an_error_and_no_output() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    io::write_surface(path("ball.obj"), &long_work().0).unwrap();
    let command = Command::new(solidmap())
        .current_dir(folder.path())
        .args(["tet", "ball.obj", "--max-volume", "1e-6", "-o", "ball.mesh"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    kill_worker(command.id(), "-ABRT");
    let output = command.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("`ball.obj`") && said.contains("SIGABRT") && !said.contains("panicked"),
        "{said}"
    );
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "nothing beside the model"
    );
}

#[test]
fn a_worker_ends_with_the_program_that_started_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    io::write_surface(folder.path().join("ball.obj"), &long_work().0).unwrap();
    let mut command = Command::new(solidmap())
        .current_dir(folder.path())
        .args(["tet", "ball.obj", "--max-volume", "1e-6", "-o", "ball.mesh"])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    let worker = loop {
        if let Some(&worker) = children(command.id()).first() {
            break worker;
        }
        assert!(begun.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(5));
    };
    command.kill().unwrap();
    command.wait().unwrap();
    let gone = || {
        let status = std::fs::read_to_string(format!("/proc/{worker}/stat")).unwrap_or_default();
        status.is_empty() || status.contains(") Z ")
    };
    while !gone() {
        assert!(begun.elapsed() < Duration::from_secs(30), "the worker works on");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn tetrahedra_that_need_more_memory_than_allowed_are_refused() {
    let _turn = turn();
    isolate(None);
    let ball = shapes::sphere(1.0, 3);
    let few = TetOptions {
        memory: Some(100_000_000),
        ..TetOptions::default()
    };
    assert!(tetrahedralize(&ball, &few).is_ok());
    let many = TetOptions {
        max_volume: Some(1e-6),
        ..few.clone()
    };
    let refused = tetrahedralize(&ball, &many).map(|mesh| mesh.tets().len());
    assert!(
        matches!(
            refused,
            Err(CgalTetgenError::TooLarge {
                allowed: 100_000_000,
                ..
            })
        ),
        "{refused:?}"
    );
    let cells = Mesh3Options {
        cell_size: Some(0.01),
        memory: few.memory,
        ..Mesh3Options::default()
    };
    let refused = tetrahedralize_mesh3(&ball, &cells).map(|mesh| mesh.tets().len());
    assert!(matches!(refused, Err(CgalTetgenError::TooLarge { .. })), "{refused:?}");
    let none = TetOptions {
        memory: Some(1_000_000),
        ..TetOptions::default()
    };
    assert!(tetrahedralize(&ball, &none).is_err());
}

#[test]
fn no_folder_for_temporary_files_is_needed() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    io::write_surface(folder.path().join("ball.obj"), &shapes::sphere(1.0, 2)).unwrap();
    let status = Command::new(solidmap())
        .current_dir(folder.path())
        .env("TMPDIR", folder.path().join("nowhere"))
        .args(["tet", "ball.obj", "-o", "ball.mesh"])
        .stdout(Stdio::null())
        .status();
    assert_eq!(status.unwrap().code(), Some(0));
}
