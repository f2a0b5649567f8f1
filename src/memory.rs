//! Available memory, what may be taken of it, and amounts as text.

use std::path::Path;

/// Memory that this process may still allocate, in bytes: by Linux's own estimate, no more than its control groups
/// (containers) allow, and no more than its address space may grow (`ulimit -v`). `None` where the system does not say.
pub fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let of_system = kib_after(&text, "MemAvailable:")?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let of_groups = left_in_groups(&groups, Path::new("/sys/fs/cgroup"));
    let limits = [of_groups, address_space()];
    Some(limits.into_iter().flatten().fold(of_system, u64::min))
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

/// What control groups leave of their limits on memory: the least of a process' own group and all above. `groups` is what
/// `/proc/self/cgroup` says, and `root` where the groups' files are. `None` without limits.
fn left_in_groups(groups: &str, root: &Path) -> Option<u64> {
    let of_line = |line: &str| -> Option<u64> {
        let [_, controllers, path] = line.splitn(3, ':').collect::<Vec<_>>().try_into().ok()?;
        // Version 2 has all controllers in one hierarchy, version 1 has one of memory.
        let (root, names) = match controllers {
            "" => (root.to_owned(), ["memory.max", "memory.current", "inactive_file"]),
            list if list.split(',').any(|name| name == "memory") => (
                root.join("memory"),
                ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"],
            ),
            _ => return None,
        };
        let own = root.join(path.trim_start_matches('/'));
        // A container sees its own group as the root, whatever its path.
        let folders = own.ancestors().take_while(|folder| folder.starts_with(&root));
        folders.filter_map(|folder| left_in_group(folder, names)).min()
    };
    groups.lines().filter_map(of_line).min()
}

/// What a group leaves of its limit, files that are cached and may be forgotten not counted.
fn left_in_group(folder: &Path, [limit, usage, inactive]: [&str; 3]) -> Option<u64> {
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).ok();
    let number = |name: &str| read(name)?.trim().parse::<u64>().ok();
    let (limit, used) = (number(limit)?, number(usage)?);
    let cached = read("memory.stat").and_then(|text| {
        let mut fields = text.lines().filter_map(|line| line.split_once(' '));
        fields.find(|(name, _)| *name == inactive)?.1.trim().parse().ok()
    });
    Some(limit.saturating_sub(used.saturating_sub(cached.unwrap_or(0))))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_of_what_control_groups_leave_counts() {
        let root = tempfile::tempdir().unwrap();
        let write = |folder: &str, files: &[(&str, &str)]| {
            let folder = root.path().join(folder);
            std::fs::create_dir_all(&folder).unwrap();
            files
                .iter()
                .for_each(|(name, text)| std::fs::write(folder.join(name), text).unwrap());
        };
        let left = |groups: &str| left_in_groups(groups, root.path());
        // No limit; a limit of the group above; one of the group itself, which keeps files in memory.
        write("a/b", &[("memory.max", "max\n"), ("memory.current", "300\n")]);
        assert_eq!(left("0::/a/b\n"), None);
        write("a", &[("memory.max", "1000\n"), ("memory.current", "400\n")]);
        assert_eq!(left("0::/a/b\n"), Some(600));
        let stat = ("memory.stat", "anon 10\ninactive_file 250\nactive_file 0\n");
        write("a/b", &[("memory.max", "700"), ("memory.current", "300"), stat]);
        assert_eq!(left("0::/a/b\n"), Some(600));
        write("a/b", &[("memory.max", "100")]);
        assert_eq!(left("0::/a/b\n"), Some(50));
        // Beyond its limit, and a path outside of a container.
        write("a/b", &[("memory.current", "800")]);
        assert_eq!(left("0::/a/b\n"), Some(0));
        assert_eq!(left("0::/docker/0123\n"), None);
        write("", &[("memory.max", "5000"), ("memory.current", "1000")]);
        assert_eq!(left("0::/docker/0123\n"), Some(4000));
        // Version 1.
        let old = ("memory.stat", "inactive_file 1\ntotal_inactive_file 20\n");
        write(
            "memory/c",
            &[("memory.limit_in_bytes", "90"), ("memory.usage_in_bytes", "60"), old],
        );
        assert_eq!(left("12:cpu,cpuacct:/c\n4:memory:/c\n"), Some(50));
        assert_eq!(left("12:cpu,cpuacct:/c\n"), None);
        assert_eq!(left("nothing"), None);
    }
}
