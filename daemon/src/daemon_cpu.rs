//! The CPU time that processes have used, by the kernel's account: a daemon's, and this one's.

use std::time::{Duration, Instant};

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use rustix::time::ClockId;

use crate::execute::used_by;

/// The worker and the supervisor of an instance, in this order.
#[derive(Clone, Debug)]
pub struct DaemonCpu {
    processes: [u32; 2],
}

impl DaemonCpu {
    pub fn of(dir: &RuntimeDir, instance: &InstanceName) -> Option<Self> {
        let record = dir.serving(instance).read_record(instance)?;
        Some(Self { processes: [record.worker_pid, record.supervisor_pid] })
    }

    /// Counts from now on: what was used by the time of a call.
    pub fn watch(&self) -> impl Fn() -> Used {
        let (daemon, start, before) = (self.clone(), Instant::now(), self.used());
        move || Used { cpu: daemon.used().saturating_sub(before), time: start.elapsed() }
    }

    pub(crate) const fn worker(&self) -> u32 {
        self.processes[0]
    }

    /// User and system time of both processes so far; a process that has exited counts nothing.
    pub fn used(&self) -> Duration {
        let of = |process: &u32| cpu_of_tasks(*process).or_else(|| cpu_of(*process));
        self.processes.iter().filter_map(of).sum()
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Used {
    pub cpu: Duration,
    time: Duration,
}

impl Used {
    /// Percent of a core: 100 is one core all the time. A hundredth is more than the kernel resolves.
    pub fn percent(&self) -> f64 {
        let share = self.cpu.as_secs_f64() / self.time.as_secs_f64().max(f64::MIN_POSITIVE);
        (share * 1e4).round() / 1e2
    }
}

pub fn own_cpu() -> Duration {
    used_by(ClockId::ProcessCPUTime)
}

pub fn nanoseconds_a(time: Duration, shares: u64) -> u64 {
    u64::try_from(time.as_nanos() / u128::from(shares.max(1))).unwrap_or(u64::MAX)
}

/// CPU time of the threads that a process has now, to the ns; `None` where the kernel keeps no such account.
fn cpu_of_tasks(process: u32) -> Option<Duration> {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).ok()?;
    let of = |task: std::fs::DirEntry| -> Option<u64> {
        // A thread that has just ended has no file.
        let stat = std::fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
        stat.split_ascii_whitespace().next().map_or(Some(0), |ns| ns.parse().ok())
    };
    let ns = tasks.flatten().map(of).sum::<Option<u64>>()?;
    (ns > 0).then(|| Duration::from_nanos(ns))
}

/// CPU time of a process so far, to the tick of 10 ms; `None` for one that no longer exists or hidden.
pub fn cpu_of(process: u32) -> Option<Duration> {
    let ticks = ticks_in(&std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?)?;
    let a_second = rustix::param::clock_ticks_per_second().max(1);
    Some(Duration::from_nanos(ticks.saturating_mul(1_000_000_000 / a_second)))
}

/// User and system time in a process's `stat`, where the name may hold spaces and brackets.
fn ticks_in(stat: &str) -> Option<u64> {
    let (_, after_name) = stat.rsplit_once(')')?;
    // Fields 14 and 15; the first one after the name is field 3.
    let mut times = after_name.split_ascii_whitespace().skip(11);
    let mut time = || times.next()?.parse::<u64>().ok();
    time()?.checked_add(time()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_behind_any_name() {
        let after = "S 1 2 3 4 5 6 7 8 9 10 41 1 0 0 20 0";
        for name in ["pairmaskd", "a b", ") (", "1 2) 3 4"] {
            assert_eq!(ticks_in(&format!("77 ({name}) {after}")), Some(42), "{name}");
        }
        for wrong in ["", "77", "77 (x", "77 (x) S 1 2", "77 (x) S 1 2 3 4 5 6 7 8 9 10 -4 1"] {
            assert_eq!(ticks_in(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_busy_process_uses_a_core_and_one_that_is_ended_nothing() {
        let own = DaemonCpu { processes: [std::process::id(), 0] };
        let used = own.watch();
        // However slow the machine: some work has to be counted at last, of this thread or of another test's.
        let before = own_cpu();
        while used().percent() <= 0.0 {
            std::hint::spin_loop();
        }
        assert!(own_cpu() > before);
        let ended = DaemonCpu { processes: [0, 0] };
        assert!(ended.watch()().percent() <= 0.0);
        let used = Used { cpu: Duration::from_millis(250), time: Duration::from_secs(1) };
        assert!((used.percent() - 25.0).abs() < 1e-9);
        let a_frame = [1_000, 0].map(|frames| nanoseconds_a(used.cpu, frames));
        assert_eq!(a_frame, [250_000, 250_000_000]);
    }
}
