//! Fences of the worker: what it tries inside them is refused, and possible without them. All else goes on.

use std::fs;
use std::os::unix::net::UnixListener;
use std::process::Command;

use pairmask_tests::command_line::eventually;
use pairmask_tests::daemon::program;
use pairmask_tests::prelude::*;
use pairmaskd::serve::fences::{Fence, FenceState, Fences};
use rustix::process::{Pid, Resource, getrlimit};
use rustix::thread::no_new_privs;

use Fence::{Landlock, NoNewPrivs, Rlimits, Seccomp};

/// What a process with fences tries, and the fences each of which refuses it alone.
const ATTEMPTS: [(&str, &[Fence]); 17] = [
    ("serve", &[]),
    ("exec", &[Landlock, Seccomp]),
    ("spawn", &[Landlock, Seccomp]),
    ("fork", &[Seccomp]),
    ("clone3", &[Seccomp]),
    ("ptrace", &[Seccomp]),
    ("unshare", &[Seccomp]),
    ("setuid", &[Seccomp]),
    ("signal", &[Landlock, Seccomp]),
    ("read-home", &[Landlock]),
    ("write-home", &[Landlock]),
    ("tcp", &[Landlock, Seccomp]),
    ("udp", &[Seccomp]),
    ("terminal", &[Seccomp]),
    ("stream", &[Seccomp]),
    ("core", &[Rlimits]),
    ("new-privs", &[NoNewPrivs, Landlock, Seccomp]),
];
/// Attempts that Landlock refuses in a later version, and lets pass in an earlier one.
const OF_LATER_KERNELS: [&str; 3] = ["signal", "tcp", "stream"];

/// A choice of fences to do without, and whether it includes each.
fn choices() -> impl Iterator<Item = (String, [bool; 4])> {
    (0..16).map(|bits| {
        let without: [bool; 4] = std::array::from_fn(|place| bits >> place & 1 == 1);
        let names = Fence::ALL.iter().zip(without).filter(|(_, is_in)| *is_in);
        let names: Vec<_> = names.map(|(fence, _)| fence.as_str()).collect();
        (if names.is_empty() { "none".into() } else { names.join(",") }, without)
    })
}

#[test]
fn each_fence_refuses_its_attempts_and_no_others() {
    let (home, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    fs::write(home.path().join("secret"), "key").unwrap();
    let _service = UnixListener::bind(home.path().join("service")).unwrap();
    // What this process may not do itself, no choice of fences allows.
    let no_core_dumps = (getrlimit(Resource::Core).maximum == Some(0)).then_some("core");
    let no_new_privs = no_new_privs().unwrap().then_some("new-privs");
    let mut refused_by = [0; 4];
    for (without, is_without) in choices() {
        for (attempt, refusers) in ATTEMPTS {
            if [no_core_dumps, no_new_privs].contains(&Some(attempt)) {
                continue;
            }
            let mut command = Command::new(program("fenced"));
            command.arg(&without).arg(dir.path()).arg(attempt).env("HOME", home.path());
            let output = command.output().unwrap();
            let _ = fs::remove_file(dir.path().join("port"));
            let said = String::from_utf8_lossy(&output.stdout).into_owned();
            let fences = Fences::from_number(said.trim().parse().unwrap()).unwrap();
            let state = |fence: Fence| fences.state(fence);
            for (fence, is_off) in Fence::ALL.into_iter().zip(is_without).skip(1) {
                assert_eq!(state(fence) == FenceState::Off, is_off, "{attempt} without {without}");
            }
            let holds = |fence: &Fence| match state(*fence) {
                FenceState::Holds | FenceState::Partly => true,
                FenceState::Unavailable | FenceState::Off => false,
            };
            let refusers: Vec<_> = refusers.iter().copied().filter(holds).collect();
            let is_open = OF_LATER_KERNELS.contains(&attempt) && holds(&Landlock);
            if is_open && !refusers.contains(&Seccomp) {
                continue;
            }
            let expected = i32::from(!refusers.is_empty());
            assert_eq!(
                output.status.code(),
                Some(expected),
                "{attempt} without {without}: {output:?}"
            );
            for fence in refusers {
                refused_by[fence as usize] += 1;
            }
        }
    }
    assert!(refused_by[Seccomp as usize] > 0, "this kernel has no seccomp: nothing was tested");
}

/// Lines of each thread's status that begin so.
fn of_threads(worker: Pid, field: &str) -> Vec<String> {
    let threads = fs::read_dir(format!("/proc/{}/task", worker.as_raw_nonzero())).unwrap();
    let statuses =
        threads.filter_map(|thread| fs::read_to_string(thread.ok()?.path().join("status")).ok());
    let line =
        |status: String| status.lines().find(|line| line.starts_with(field)).map(str::to_owned);
    statuses.filter_map(line).collect()
}

fn reported(daemon: &TestDaemon) -> Fences {
    Fences::from_number(eventually("a record", || daemon.record()).fences).unwrap()
}

#[test]
fn all_threads_of_a_worker_are_fenced_and_so_are_those_of_the_next() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let mut session = daemon.connect();
    let boxes = stress_scenes::named("uniform").boxes(3_000, 1);
    for _ in 0..3 {
        assert_eq!(session.answer(&boxes).sorted(), oracle::truth(&boxes).pairs);
        let worker = daemon.worker();
        let seccomp = of_threads(worker, "Seccomp:");
        assert!(seccomp.len() > 5, "{seccomp:?}");
        assert!(seccomp.iter().all(|line| line == "Seccomp:\t2"), "{seccomp:?}");
        let rights = of_threads(worker, "NoNewPrivs:");
        assert!(rights.iter().all(|line| line == "NoNewPrivs:\t1"), "{rights:?}");
        let limits =
            fs::read_to_string(format!("/proc/{}/limits", worker.as_raw_nonzero())).unwrap();
        let core = limits.lines().find(|line| line.starts_with("Max core")).unwrap();
        assert_eq!(core.split_whitespace().skip(4).take(2).collect::<Vec<_>>(), ["0", "0"]);
        for fence in [NoNewPrivs, Seccomp, Rlimits] {
            assert_eq!(reported(&daemon).state(fence), FenceState::Holds, "{fence:?}");
        }
        assert_ne!(reported(&daemon).state(Landlock), FenceState::Off);
        daemon.signal_worker(Signal::KILL);
        until("another worker serves", || daemon.record().is_some() && daemon.worker() != worker);
        daemon.wait_for_gpus();
        session = daemon.connect();
    }
}

#[test]
fn a_worker_without_fences_serves() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--without-fence", "all"]);
    let boxes = stress_scenes::named("uniform").boxes(300, 1);
    assert_eq!(daemon.connect().answer(&boxes).sorted(), oracle::truth(&boxes).pairs);
    let seccomp = of_threads(daemon.worker(), "Seccomp:");
    let own = of_threads(rustix::process::getpid(), "Seccomp:");
    assert!(seccomp.iter().all(|line| *line == own[0]), "{seccomp:?}");
    assert!(Fence::ALL.iter().all(|fence| reported(&daemon).state(*fence) == FenceState::Off));
}
