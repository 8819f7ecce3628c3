//! A sample: what the worker of a daemon takes of the machine at one time, by the kernel's account.

use std::fs;
use std::time::Duration;

use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use pairmaskd::daemon_cpu::DaemonCpu;
use rustix::fs::statvfs;
use serde::Serialize;

use super::probe::Probed;

/// Where the kernel keeps shared memory files.
const SHM_DIR: &str = "/dev/shm";

/// A row of `samples` in the JSON. Null is what could not be read.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Sample {
    pub(crate) at_ns: u64,
    pub(crate) worker_pid: Option<u32>,
    pub(crate) anonymous_bytes: Option<u64>,
    pub(crate) shared_bytes: Option<u64>,
    pub(crate) descriptors: Option<u64>,
    pub(crate) mappings: Option<u64>,
    pub(crate) threads: Option<u64>,
    /// Of all programs together.
    pub(crate) shm_used_bytes: Option<u64>,
    pub(crate) shm_files: Option<u64>,
    pub(crate) probe_frames: u64,
    pub(crate) probe_lost: u64,
    pub(crate) probe_p50_ns: Option<u64>,
    pub(crate) probe_p99_ns: Option<u64>,
    /// Of worker and supervisor, since the sample before.
    pub(crate) daemon_cpu_percent: Option<f64>,
}

#[derive(Debug)]
pub(crate) struct Watch {
    dir: RuntimeDir,
    instance: InstanceName,
    /// CPU time of the daemon by the last sample, and when that was.
    used: Option<(Duration, Duration)>,
}

impl Watch {
    pub(crate) fn new(dir: &RuntimeDir, instance: &InstanceName) -> Self {
        Self { dir: dir.serving(instance), instance: instance.clone(), used: None }
    }

    pub(crate) fn sample(&mut self, at: Duration, probed: &Probed) -> Sample {
        // A supervisor that is starting another worker leaves the record of the one before, whose files are gone.
        let worker_pid = self.dir.read_record(&self.instance).map(|record| record.worker_pid);
        let file = |name: &str| Some(format!("/proc/{}/{name}", worker_pid?));
        let text = |name: &str| fs::read_to_string(file(name)?).ok();
        let status = text("status").unwrap_or_default();
        let bytes = |key| status_number(&status, key).map(|kib| kib.saturating_mul(1_024));
        let has_probed = probed.frames > 0;
        let latency = probed.latency.percentiles();
        let prefix = self.dir.shm_prefix(&self.instance);
        Sample {
            at_ns: at.as_nanos() as u64,
            worker_pid,
            anonymous_bytes: bytes("RssAnon"),
            shared_bytes: bytes("RssShmem"),
            descriptors: file("fd").and_then(|dir| files_in(&dir, "")),
            mappings: text("maps").map(|maps| maps.lines().count() as u64),
            threads: status_number(&status, "Threads"),
            shm_used_bytes: shm_used_bytes(),
            shm_files: files_in(SHM_DIR, &prefix),
            probe_frames: probed.frames,
            probe_lost: probed.lost,
            probe_p50_ns: has_probed.then_some(latency.p50),
            probe_p99_ns: has_probed.then_some(latency.p99),
            daemon_cpu_percent: self.cpu_percent(at),
        }
    }

    fn cpu_percent(&mut self, at: Duration) -> Option<f64> {
        let used = DaemonCpu::of(&self.dir, &self.instance)?.used();
        let (before, since) = self.used.replace((used, at))?;
        let share = used.checked_sub(before)?.as_secs_f64() / at.checked_sub(since)?.as_secs_f64();
        // A hundredth is more than the kernel resolves.
        Some((share * 1e4).round() / 1e2)
    }
}

impl Sample {
    /// One line that says how it goes.
    pub(crate) fn line(&self) -> String {
        let number = |value: Option<u64>| value.map_or("?".to_owned(), |value| value.to_string());
        let mib = |bytes: Option<u64>| number(bytes.map(|bytes| bytes >> 20));
        let us = |ns: Option<u64>| number(ns.map(|ns| ns / 1_000));
        format!(
            "{} MiB anonymous, {} MiB shared, {} descriptors, {} mappings, {} threads; /dev/shm {} MiB, {} files; \
             probe p50 {} µs, p99 {} µs",
            mib(self.anonymous_bytes),
            mib(self.shared_bytes),
            number(self.descriptors),
            number(self.mappings),
            number(self.threads),
            mib(self.shm_used_bytes),
            number(self.shm_files),
            us(self.probe_p50_ns),
            us(self.probe_p99_ns),
        )
    }
}

/// How often another worker served than in the sample before.
pub(crate) fn restarts(samples: &[Sample]) -> u64 {
    let workers: Vec<u32> = samples.iter().filter_map(|sample| sample.worker_pid).collect();
    workers.windows(2).filter(|two| two[0] != two[1]).count() as u64
}

/// The number behind a key in a process's `status`, where kB is the only unit.
fn status_number(status: &str, key: &str) -> Option<u64> {
    let value = |line: &str| {
        let (found, value) = line.split_once(':')?;
        (found == key).then(|| value.split_ascii_whitespace().next()?.parse().ok())?
    };
    status.lines().find_map(value)
}

fn files_in(dir: &str, prefix: &str) -> Option<u64> {
    let names = fs::read_dir(dir).ok()?.flatten().map(|file| file.file_name());
    let is_so = |name: &std::ffi::OsString| name.as_encoded_bytes().starts_with(prefix.as_bytes());
    Some(names.filter(is_so).count() as u64)
}

fn shm_used_bytes() -> Option<u64> {
    let space = statvfs(SHM_DIR).ok()?;
    Some(space.f_blocks.saturating_sub(space.f_bfree).saturating_mul(space.f_frsize))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_behind_their_whole_key() {
        let status =
            "Name:\ta: b\nVmRSS:\t   9 kB\nRssAnon:\t    1234 kB\nThreads:\t7\nSigQ:\t1/2\n";
        assert_eq!(status_number(status, "RssAnon"), Some(1_234));
        assert_eq!(status_number(status, "Threads"), Some(7));
        for key in ["Rss", "Name", "SigQ", "", "a"] {
            assert_eq!(status_number(status, key), None, "{key}");
        }
    }

    #[test]
    fn a_restart_is_another_worker_whatever_was_unreadable_between() {
        let of = |pids: &[Option<u32>]| {
            let sample = |pid: &Option<u32>| Sample { worker_pid: *pid, ..Sample::default() };
            restarts(&pids.iter().map(sample).collect::<Vec<_>>())
        };
        assert_eq!(of(&[]), 0);
        assert_eq!(of(&[Some(1), Some(1), None, Some(1)]), 0);
        assert_eq!(of(&[Some(1), None, Some(2), Some(2), Some(1)]), 2);
    }

    #[test]
    fn this_process_takes_something_of_everything() {
        let pid = std::process::id();
        let status = fs::read_to_string(format!("/proc/{pid}/status")).expect("a status");
        assert!(status_number(&status, "RssAnon").is_some_and(|kib| kib > 100));
        assert!(status_number(&status, "RssShmem").is_some());
        assert!(files_in(&format!("/proc/{pid}/fd"), "").is_some_and(|files| files > 2));
        assert!(shm_used_bytes().is_some() && files_in("/proc/nobody", "").is_none());
    }
}
