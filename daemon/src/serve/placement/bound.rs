//! The cores to which clients have bound threads.

use std::collections::BTreeSet;
use std::fs;

use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity};

/// Threads of a process that are looked at: one takes 0.3 µs, and engines have some tens.
const MOST_THREADS: usize = 256;

/// The cores to each of which a thread of one of these processes is bound: it may run on no other. What the system
/// does not tell, as of a process that has ended, is left out.
pub(super) fn bound_cores(processes: &BTreeSet<u32>) -> BTreeSet<usize> {
    let threads = processes.iter().flat_map(|process| {
        let entries = fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten();
        entries
            .take(MOST_THREADS)
            .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse::<i32>().ok())
    });
    let affinities =
        threads.filter_map(|thread| sched_getaffinity(Some(Pid::from_raw(thread)?)).ok());
    affinities.filter_map(|cores| only_core(&cores)).collect()
}

/// The one core of a set; `None` where it has several.
fn only_core(cores: &CpuSet) -> Option<usize> {
    (cores.count() == 1).then(|| (0..CpuSet::MAX_CPU).find(|core| cores.is_set(*core)))?
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;
    use std::thread;

    use rustix::thread::sched_setaffinity;

    use super::*;

    #[test]
    fn a_thread_that_may_run_on_one_core_is_bound_to_it() {
        let here = BTreeSet::from([std::process::id()]);
        let allowed = sched_getaffinity(None).expect("this thread's cores");
        let last = (0..CpuSet::MAX_CPU).rfind(|core| allowed.is_set(*core)).expect("a core");
        let (bound, is_bound) = channel();
        let (end, is_over) = channel::<()>();
        let thread = thread::spawn(move || {
            let mut one = CpuSet::new();
            one.set(last);
            sched_setaffinity(None, &one).expect("its own core");
            bound.send(()).expect("a test");
            let _ = is_over.recv();
        });
        is_bound.recv().expect("a thread");
        assert!(bound_cores(&here).contains(&last));
        drop(end);
        thread.join().expect("no panic");
        assert_eq!(bound_cores(&BTreeSet::from([0, u32::MAX])), BTreeSet::new(), "no processes");
    }

    #[test]
    fn a_set_of_several_cores_binds_to_none() {
        let mut cores = CpuSet::new();
        assert_eq!(only_core(&cores), None);
        cores.set(3);
        assert_eq!(only_core(&cores), Some(3));
        cores.set(70);
        assert_eq!(only_core(&cores), None);
    }
}
