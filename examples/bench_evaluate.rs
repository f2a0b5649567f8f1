//! CPU seconds of evaluating a map file at points in the unit ball's box, the median after one call to warm up: what
//! `cpp/tests/bench_evaluate.cpp` measures from C++.
//!
//! `cargo run --release --example bench_evaluate -- [MAP] [POINTS] [RUNS]`: map.safetensors, 1 000 000 and 9 by
//! default.

use solidmap::Point;
use solidmap::files::read_map;
use solidmap::map::VolumeMap;

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or("map.safetensors".into());
    let count: u32 = arguments.next().map_or(Ok(1_000_000), |count| count.parse())?;
    let runs: usize = arguments.next().map_or(Ok(9), |runs| runs.parse())?;
    let map = read_map(path.as_ref())?.map;
    // Fractional parts of the multiples of three irrational numbers fill a cube evenly.
    let along = |i: u32, step: f64| 0.5 * (2.0 * (f64::from(i) * step).fract() - 1.0);
    let points: Vec<Point> = (0..count)
        .map(|i| Point::from([0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9].map(|step| along(i, step))))
        .collect();
    let (mut values, mut both) = (vec![], vec![]);
    map.evaluate(&points);
    for _ in 0..runs {
        let start = cpu_seconds()?;
        let images = map.evaluate(&points);
        values.push(cpu_seconds()? - start);
        assert_eq!(images.len(), points.len());
        let start = cpu_seconds()?;
        let found = map.evaluate_with_jacobian(&points);
        both.push(cpu_seconds()? - start);
        assert_eq!(found.1.len(), points.len());
    }
    println!(
        "{{\"evaluate\": {:.4}, \"evaluate_with_jacobian\": {:.4}}}",
        median(values),
        median(both)
    );
    Ok(())
}

/// User and system time of this process so far, in seconds; Linux counts hundredths.
fn cpu_seconds() -> Result<f64, Box<dyn std::error::Error>> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    // Fields 14 and 15; the second is the name in parentheses.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks = fields.skip(11).take(2).map(str::parse::<f64>).sum::<Result<f64, _>>()?;
    Ok(ticks / 100.0)
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
