//! The cores that serve the interrupts of GPUs, where the kernel names them.
//!
//! A lane that waits for a GPU on such a core shares it with the driver (an H200: a frame of 1,000 boxes took 58 µs in
//! place of 29). The scheduler knows nothing of that, since interrupts are no threads.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use rustix::thread::CpuSet;

/// The cores that serve interrupts of devices with these PCI addresses, by what the kernel says below `root`. Where it
/// says nothing, none; and none for interrupts that have not come: a device has one for each of many cores, and uses
/// few of them.
pub(super) fn serving_cores(root: &Path, gpus: &[String]) -> BTreeSet<usize> {
    let counts = fs::read_to_string(root.join("proc/interrupts")).unwrap_or_default();
    let interrupts = gpus.iter().filter(|address| !address.is_empty()).flat_map(|address| {
        // Named by their numbers.
        let folder = root.join("sys/bus/pci/devices").join(address).join("msi_irqs");
        let entries = fs::read_dir(folder).into_iter().flatten();
        entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok())
    });
    let cores =
        interrupts.filter(|interrupt| has_come(&counts, interrupt)).filter_map(|interrupt| {
            let folder = root.join("proc/irq").join(interrupt);
            // Where it goes, and not where it may go. Older kernels tell the latter alone, which is all cores mostly.
            let told = ["effective_affinity_list", "smp_affinity_list"];
            let list = told.iter().find_map(|file| fs::read_to_string(folder.join(file)).ok())?;
            cores_of(list.trim())
        });
    cores.flatten().collect()
}

/// Whether an interrupt has come, by the table of all counts: a line for each, its number and then a count a core.
fn has_come(counts: &str, interrupt: &str) -> bool {
    let lines = counts.lines().filter_map(|line| line.trim_start().split_once(':'));
    let mut own = lines.filter(|(number, _)| *number == interrupt);
    own.any(|(_, counts)| {
        let counts = counts.split_whitespace().map_while(|count| count.parse::<u64>().ok());
        counts.sum::<u64>() > 0
    })
}

/// The cores of a list such as `0-3,8`; `None` where it is no such list.
fn cores_of(list: &str) -> Option<Vec<usize>> {
    let ranges = list.split(',').filter(|range| !range.is_empty()).map(|range| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        let (first, last) = (first.parse().ok()?, last.parse().ok()?);
        (last < CpuSet::MAX_CPU).then_some(first..=last)
    });
    let ranges: Option<Vec<_>> = ranges.collect();
    Some(ranges?.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cores_are_read_as_the_kernel_writes_them() {
        assert_eq!(cores_of("5"), Some(vec![5]));
        assert_eq!(cores_of("0-2,8"), Some(vec![0, 1, 2, 8]));
        assert_eq!(cores_of(""), Some(vec![]));
        for wrong in ["x", "1-", "-1", "1-2-3", "4294967296", "0-99999999"] {
            assert_eq!(cores_of(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn the_kernel_tells_which_cores_serve_a_device() {
        let root = tempfile::tempdir().expect("a folder");
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(path, text).expect("written");
        };
        for interrupt in [40, 41, 42] {
            write(&format!("sys/bus/pci/devices/0000:1b:00.0/msi_irqs/{interrupt}"), "msix\n");
        }
        for interrupt in [50, 51] {
            write(&format!("sys/bus/pci/devices/0000:2b:00.0/msi_irqs/{interrupt}"), "msi\n");
        }
        let counts = "           CPU0       CPU1\n  8:   9  9   rtc0\n 40:  0  7  nvidia\n 41:  1  0  nvidia\n \
            42:  5  5  nvidia\n 50:  2  0  nvidia\n 51:  0  0  nvidia 99\nNMI:   3  3  Non-maskable interrupts\n";
        write("proc/interrupts", counts);
        write("proc/irq/51/effective_affinity_list", "9\n");
        write("proc/irq/40/effective_affinity_list", "3\n");
        write("proc/irq/40/smp_affinity_list", "0-15\n");
        write("proc/irq/41/smp_affinity_list", "7\n");
        write("proc/irq/42/effective_affinity_list", "nonsense\n");
        write("proc/irq/50/effective_affinity_list", "1-2\n");
        let of = |gpus: &[&str]| {
            let gpus: Vec<String> = gpus.iter().map(|gpu| (*gpu).to_owned()).collect();
            serving_cores(root.path(), &gpus).into_iter().collect::<Vec<_>>()
        };
        assert_eq!(of(&["0000:1b:00.0"]), [3, 7]);
        assert_eq!(of(&["0000:1b:00.0", "0000:2b:00.0"]), [1, 2, 3, 7]);
        // A software adapter has no address; others may have no interrupts, or be no device.
        assert_eq!(of(&["", "0000:99:00.0"]), [0usize; 0]);
        assert_eq!(of(&[]), [0usize; 0]);
    }
}
