//! The time that a daemon's processes have used, by the kernel's account.

use std::time::{Duration, Instant};

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;

/// The worker and the supervisor of an instance.
#[derive(Clone, Debug)]
pub struct DaemonCpu {
    processes: [u32; 2],
    tick: Duration,
}

/// A moment from which the use is counted.
#[derive(Clone, Debug)]
pub struct Since {
    at: Instant,
    used: Duration,
}

impl DaemonCpu {
    /// The processes that serve an instance now; `None` where none do.
    pub fn of(dir: &RuntimeDir, instance: &InstanceName) -> Option<Self> {
        let record = dir.serving(instance).read_record(instance)?;
        let ticks = u32::try_from(rustix::param::clock_ticks_per_second()).unwrap_or(u32::MAX);
        Some(Self {
            processes: [record.worker_pid, record.supervisor_pid],
            tick: Duration::from_secs(1) / ticks.max(1),
        })
    }

    pub fn since_now(&self) -> Since {
        Since { at: Instant::now(), used: self.used() }
    }

    /// Percent of a core that was used since then: 100 is one core all the time. The kernel counts in
    /// ticks of 10 ms: in a second, a percent is within its error.
    pub fn percent(&self, since: &Since) -> f64 {
        let used = self.used().saturating_sub(since.used);
        percent(used, since.at.elapsed())
    }

    /// User and system time of both processes so far; a process that is gone counts nothing.
    fn used(&self) -> Duration {
        let ticks: u64 = self.processes.iter().map(|process| ticks_of(*process)).sum();
        self.tick.saturating_mul(u32::try_from(ticks).unwrap_or(u32::MAX))
    }
}

/// A hundredth of a percent is more than the kernel tells.
fn percent(used: Duration, window: Duration) -> f64 {
    let share = used.as_secs_f64() / window.as_secs_f64().max(f64::MIN_POSITIVE);
    (share * 1e4).round() / 1e2
}

fn ticks_of(process: u32) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    ticks_in(&stat).unwrap_or(0)
}

/// User and system time in a process's `stat`. Its second field, the name in brackets, may hold spaces
/// and brackets.
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
    fn a_busy_process_uses_a_core_and_one_that_is_gone_nothing() {
        let tick = Duration::from_millis(10);
        let own = DaemonCpu { processes: [std::process::id(), 0], tick };
        let since = own.since_now();
        // However slow the machine: some work has to be counted at last, of this thread or of another test's.
        while own.percent(&since) <= 0.0 {
            std::hint::spin_loop();
        }
        let gone = DaemonCpu { processes: [0, 0], tick };
        assert!(gone.percent(&gone.since_now()) <= 0.0);
        assert!((percent(tick * 25, Duration::from_secs(1)) - 25.0).abs() < 1e-9);
    }
}
