//! How much memory a process may use, as Linux says: that of the machine, and the limits of control groups.

use std::path::{Path, PathBuf};

/// Bytes of memory that this process may use. `None` where the system does not say.
pub fn bytes() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().as_deref().and_then(total_bytes);
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let limits = limit_files(&groups).filter_map(|file| std::fs::read_to_string(file).ok());
    // A group without a limit says `max`, or a number beyond any memory.
    let limits = limits.filter_map(|text| text.trim().parse().ok());
    limits.chain(machine).min()
}

/// The memory of the machine, by the text of `/proc/meminfo`.
fn total_bytes(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Files that may hold a limit of the groups in the text of `/proc/self/cgroup`: of each group, and of those that it
/// is in, by the second and the first version of control groups.
fn limit_files(groups: &str) -> impl Iterator<Item = PathBuf> {
    groups.lines().flat_map(|line| {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, group) = (fields.next().unwrap_or("-"), fields.next().unwrap_or("/"));
        let slot = match controllers {
            "" => Some(("/sys/fs/cgroup", "memory.max")),
            all if all.split(',').any(|one| one == "memory") => {
                Some(("/sys/fs/cgroup/memory", "memory.limit_in_bytes"))
            }
            _ => None,
        };
        let group = Path::new(group.trim_start_matches('/'));
        let up =
            move |(root, name)| group.ancestors().map(move |g| Path::new(root).join(g).join(name));
        slot.into_iter().flat_map(up)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_memory_is_read() {
        let text = "MemFree:  1 kB\nMemTotal:       24601460 kB\nMemAvailable: 3 kB\n";
        assert_eq!(total_bytes(text), Some(24_601_460 * 1024));
        assert_eq!(total_bytes("MemTotal: many kB"), None);
        assert_eq!(total_bytes(""), None);
        assert!(bytes().is_some_and(|bytes| bytes > 1 << 20), "this machine has some");
    }

    #[test]
    fn a_group_and_those_around_it_may_limit_memory() {
        let files: Vec<_> = limit_files("0::/a/b\n").collect();
        let expected = ["a/b/memory.max", "a/memory.max", "memory.max"];
        assert_eq!(files, expected.map(|file| Path::new("/sys/fs/cgroup").join(file)));
        let files: Vec<_> =
            limit_files("5:cpu,memory:/x\n4:cpuset:/\n1:name=systemd:/\n").collect();
        let expected = ["x/memory.limit_in_bytes", "memory.limit_in_bytes"];
        assert_eq!(files, expected.map(|file| Path::new("/sys/fs/cgroup/memory").join(file)));
        assert_eq!(limit_files("0::/\n").count(), 1);
        assert_eq!(limit_files("nonsense\n\n").count(), 0);
    }
}
