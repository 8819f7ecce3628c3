//! `install-service`: a unit is written and removed, and one of somebody else's stays.

use std::fs;
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::time::Duration;

use pairmask_transport::RuntimeDir;
use rustix::process::Signal;

use crate::support::{Finished, PAIRMASKD, Sandbox, Serving, run_with};

struct Home {
    sandbox: Sandbox,
    config: String,
}

impl Home {
    fn new() -> Self {
        let sandbox = Sandbox::new();
        let config = sandbox.file("config").display().to_string();
        Self { sandbox, config }
    }

    fn run(&self, flags: &str) -> Finished {
        let line = format!("install-service {flags}");
        run_with(&self.sandbox, &line, &[("XDG_CONFIG_HOME", self.config.as_str())])
    }

    fn unit(&self, name: &str) -> PathBuf {
        PathBuf::from(&self.config).join("systemd/user").join(name)
    }
}

#[test]
fn a_unit_is_printed_written_and_removed() {
    let home = Home::new();
    for (flags, name, command) in [
        ("", "pairmaskd.service", format!("ExecStart=\"{PAIRMASKD}\" serve\n")),
        (
            "--instance world",
            "pairmaskd-world.service",
            format!("ExecStart=\"{PAIRMASKD}\" serve --instance world\n"),
        ),
    ] {
        let printed = home.run(&format!("{flags} --print"));
        assert_eq!((printed.code, printed.stderr.as_str()), (Some(0), ""), "{printed:?}");
        assert!(printed.stdout.contains(&command), "{printed:?}");
        assert!(!home.unit(name).exists());
        for _ in 0..2 {
            let written = home.run(flags);
            assert_eq!(written.code, Some(0), "{written:?}");
            assert!(written.stdout.contains(name), "{written:?}");
            assert!(written.stderr.contains("systemctl --user enable --now"), "{written:?}");
            assert_eq!(fs::read_to_string(home.unit(name)).unwrap(), printed.stdout);
        }
        let wants = home.unit("default.target.wants");
        fs::create_dir_all(&wants).unwrap();
        symlink(home.unit(name), wants.join(name)).unwrap();
        for _ in 0..2 {
            let removed = home.run(&format!("{flags} --uninstall"));
            assert_eq!(removed.code, Some(0), "{removed:?}");
            assert!(!home.unit(name).exists() && !wants.join(name).is_symlink());
        }
    }
}

#[test]
fn a_unit_of_somebody_else_stays() {
    let home = Home::new();
    let path = home.unit("pairmaskd.service");
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, "[Service]\nExecStart=/bin/true\n").unwrap();
    for flags in ["", "--uninstall"] {
        let refused = home.run(flags);
        assert!(refused.error(1).contains("not written by this command"), "{refused:?}");
        assert!(fs::read_to_string(&path).unwrap().contains("/bin/true"));
    }
    let wrong = home.run("--print --uninstall");
    assert!(wrong.error(2).contains("exclude each other"), "{wrong:?}");
    let lost = run_with(&home.sandbox, "install-service", &[("XDG_CONFIG_HOME", ""), ("HOME", "")]);
    assert!(lost.error(1).contains("set HOME"), "{lost:?}");
}

/// As a service manager listens.
#[test]
fn a_service_manager_is_told_that_it_serves_lives_and_stops() {
    let sandbox = Sandbox::new();
    let path = sandbox.file("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let received = || {
        let mut bytes = [0; 64];
        let len = manager.recv(&mut bytes).unwrap();
        String::from_utf8(bytes[..len].to_vec()).unwrap()
    };
    let mut command = sandbox.line("serve");
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "400000");
    let dir = RuntimeDir::at(sandbox.path());
    let serving = Serving::of(command.spawn().unwrap(), dir, "default");
    assert_eq!(received(), "READY=1");
    for _ in 0..3 {
        assert_eq!(received(), "WATCHDOG=1");
    }
    let worker = format!("/proc/{}/environ", serving.record().worker_pid);
    let worker = String::from_utf8(fs::read(worker).unwrap()).unwrap();
    assert!(!worker.contains("NOTIFY_SOCKET") && !worker.contains("WATCHDOG_USEC"), "{worker}");
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    while received() != "STOPPING=1" {}
}
