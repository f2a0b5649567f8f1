//! Available memory, what may be taken of it, and amounts as text.

/// Memory that this process may still allocate, in bytes: by Linux's own estimate, and no more than its address space may
/// grow (`ulimit -v`). Limits of control groups (containers) are not seen. `None` where the system does not say.
pub fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let of_system = kib_after(&text, "MemAvailable:")?;
    Some(of_system.min(address_space().unwrap_or(u64::MAX)))
}

/// Bytes to allocate at most unless told otherwise: nine tenths of what is [`available`].
pub fn default_budget() -> Option<u64> {
    available().map(nine_tenths)
}

/// [`default_budget`] for work that decomposes matrices. The matrix kernels reserve a gibibyte of address space per
/// thread, use little of it, and abort where that is refused.
pub(crate) fn default_solver_budget() -> Option<u64> {
    let addresses = solver_addresses().unwrap_or(u64::MAX);
    Some(nine_tenths(available()?.min(addresses)))
}

/// Address space for such work beyond what the matrix kernels reserve, where it is limited (`ulimit -v`).
pub(crate) fn solver_addresses() -> Option<u64> {
    const RESERVED: u64 = 1 << 30;
    let threads = rayon::current_num_threads() as u64 + 1;
    address_space().map(|bytes| bytes.saturating_sub(threads * RESERVED))
}

fn nine_tenths(bytes: u64) -> u64 {
    (0.9 * bytes as f64) as u64
}

/// Bytes by which the address space may grow, where it is limited.
fn address_space() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = limit.split_ascii_whitespace().next()?.parse().ok()?;
    Some(limit.saturating_sub(kib_after(&status, "VmSize:")?))
}

fn kib_after(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024)
}

/// An amount in MiB or GiB, for messages.
pub fn readable(bytes: u64) -> String {
    let mib = bytes as f64 / f64::from(1 << 20);
    if mib < 1000.0 {
        format!("{mib:.0} MiB")
    } else {
        format!("{:.1} GiB", mib / 1024.0)
    }
}
