//! What is wrong with a machine, by what is known of it. Nothing is read here.

use serde::Serialize;

use super::facts::{
    Daemon, Daemons, DirectoryState, Facts, Limits, Logout, Memory, RuntimeDirectory, SharedMemory,
};
use super::judge_gpus;
use crate::cli::output::size_text;
use crate::cli::status::{State, fences_text};
use crate::serve::FILES_PER_CLIENT;
use crate::serve::fences::{Fence, FenceState};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Check {
    Kernel,
    SharedMemory,
    Memory,
    OpenFiles,
    AddressSpace,
    RuntimeDir,
    Daemon,
    PidNamespace,
    Fences,
    LeftFiles,
    Logout,
    Governor,
    Clock,
    InstructionSet,
    Vulkan,
    Gpu,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// It works, and could work better.
    Warning,
    Problem,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    pub check: Check,
    pub level: Level,
    pub cause: String,
    pub cure: String,
}

impl Check {
    pub const ALL: [Self; 16] = [
        Self::Kernel,
        Self::SharedMemory,
        Self::Memory,
        Self::OpenFiles,
        Self::AddressSpace,
        Self::RuntimeDir,
        Self::Daemon,
        Self::PidNamespace,
        Self::Fences,
        Self::LeftFiles,
        Self::Logout,
        Self::Governor,
        Self::Clock,
        Self::InstructionSet,
        Self::Vulkan,
        Self::Gpu,
    ];

    pub const fn title(self) -> &'static str {
        match self {
            Self::Kernel => "kernel",
            Self::SharedMemory => "shared memory",
            Self::Memory => "memory",
            Self::OpenFiles => "open files",
            Self::AddressSpace => "address space",
            Self::RuntimeDir => "runtime directory",
            Self::Daemon => "daemon",
            Self::PidNamespace => "PID namespace",
            Self::Fences => "fences",
            Self::LeftFiles => "left files",
            Self::Logout => "logout",
            Self::Governor => "clocks of cores",
            Self::Clock => "clock",
            Self::InstructionSet => "instruction set",
            Self::Vulkan => "Vulkan",
            Self::Gpu => "GPU",
        }
    }

    pub fn problem(self, cause: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { check: self, level: Level::Problem, cause: cause.into(), cure: cure.into() }
    }

    pub fn warning(self, cause: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { level: Level::Warning, ..self.problem(cause, cure) }
    }
}

/// All that is wrong, in the order of the checks. A healthy machine has no finding.
pub fn judge(facts: &Facts) -> Vec<Finding> {
    let mut findings: Vec<Finding> = [
        kernel(facts.kernel),
        shared_memory(&facts.shm),
        memory(facts.memory),
        open_files(facts.limits),
        address_space(facts.limits),
        runtime_dir(&facts.runtime_dir),
        no_daemon(&facts.daemons, &facts.runtime_dir),
        left_files(facts),
        logout(facts.logout),
        governor(&facts.governors),
        clock(facts.clock.as_deref()),
        instruction_set(facts),
        judge_gpus::vulkan(&facts.gpu),
    ]
    .into_iter()
    .flatten()
    .collect();
    findings.extend(facts.daemons.found.iter().filter_map(silent_daemon));
    findings.extend(facts.daemons.found.iter().filter_map(fences));
    findings.extend(judge_gpus::gpus(&facts.gpu));
    findings.sort_by_key(|finding| finding.check as u8);
    findings
}

/// `MADV_POPULATE_WRITE`, by which memory is made present before it is written to.
const POPULATES_SINCE: (u32, u32) = (5, 14);

fn kernel(version: Option<(u32, u32)>) -> Option<Finding> {
    let (major, minor) = version.filter(|version| *version < POPULATES_SINCE)?;
    Some(Check::Kernel.warning(
        format!("Linux {major}.{minor} cannot say that /dev/shm is full before it is written to: then a process dies by SIGBUS"),
        "use Linux 5.14 or later; 6.12 has all that the fences need",
    ))
}

/// Less than this is too little for a few clients with small frames.
const LEAST_SHM_BYTES: u64 = 4 << 20;
/// A frame of a million boxes takes 72 MB; Docker gives 64 MiB.
const SMALL_SHM_BYTES: u64 = 128 << 20;

fn shared_memory(shm: &SharedMemory) -> Option<Finding> {
    let check = Check::SharedMemory;
    let SharedMemory { is_there, is_tmpfs, is_writable, total_bytes, free_bytes } = *shm;
    let larger = "`mount -o remount,size=4G /dev/shm`, or `--shm-size 1g` of `docker run`";
    if !is_there {
        return Some(check.problem("there is no /dev/shm", "mount -t tmpfs tmpfs /dev/shm"));
    }
    if !is_writable {
        return Some(
            check.problem("you may not write to /dev/shm", "chmod 1777 /dev/shm, as root"),
        );
    }
    if !is_tmpfs {
        let cause = "/dev/shm is not in memory (no tmpfs): frames are written to a disk";
        return Some(check.warning(cause, "mount -t tmpfs tmpfs /dev/shm"));
    }
    let is_limited = total_bytes != 0;
    if is_limited && free_bytes < LEAST_SHM_BYTES {
        let (free, total) = (size_text(free_bytes), size_text(total_bytes));
        let cause = format!("/dev/shm is full: {free} of {total} are free");
        return Some(
            check.problem(cause, format!("free space there, or make it larger: {larger}")),
        );
    }
    (is_limited && total_bytes < SMALL_SHM_BYTES).then(|| {
        let cause = format!("/dev/shm is small: {}", size_text(total_bytes));
        check.warning(cause, format!("make it larger for frames of many boxes: {larger}"))
    })
}

/// A daemon that has less refuses frames that others find small.
const LITTLE_MEMORY_BYTES: u64 = 512 << 20;

fn memory(memory: Memory) -> Option<Finding> {
    let usable = memory.usable_bytes?;
    if memory.max_bytes > usable {
        let (most, usable) = (size_text(memory.max_bytes), size_text(usable));
        return Some(Check::Memory.problem(
            format!("a daemon may take {most}, and this machine or control group has {usable}: the kernel would kill it"),
            "serve with a smaller --max-memory (PAIRMASK_MAX_MEMORY), or leave it out",
        ));
    }
    (usable < LITTLE_MEMORY_BYTES).then(|| {
        let cause = format!("this machine or control group has {} of memory", size_text(usable));
        Check::Memory.warning(cause, "raise the limit of the container or service (MemoryMax)")
    })
}

fn open_files(limits: Limits) -> Option<Finding> {
    let Limits { clients, needed_files, .. } = limits;
    let limit = limits.files.filter(|limit| *limit < needed_files)?;
    let over = (needed_files - limit).div_ceil(FILES_PER_CLIENT) as usize;
    let fit = match clients.saturating_sub(over) {
        0 => String::new(),
        fit => format!(", or serve with --max-clients {fit}"),
    };
    Some(Check::OpenFiles.problem(
        format!("{clients} clients need up to {needed_files} open files, and a process may have {limit}: `serve` would not start"),
        format!("raise the hard limit (`ulimit -Hn`, LimitNOFILE of a service){fit}"),
    ))
}

/// In so much a daemon on cores serves its clients (a test serves in 8,000,000 KiB).
const ENOUGH_ADDRESS_SPACE_BYTES: u64 = 8_000_000 << 10;

fn address_space(limits: Limits) -> Option<Finding> {
    let limit = limits.address_space_bytes?;
    (limit < ENOUGH_ADDRESS_SPACE_BYTES).then(|| {
        Check::AddressSpace.warning(
            format!("a process may have {} of address space (RLIMIT_AS): shared memory of large frames does not fit, and drivers of GPUs take more", size_text(limit)),
            "`ulimit -v unlimited`; a batch queue has a setting for it",
        )
    })
}

fn runtime_dir(dir: &RuntimeDirectory) -> Option<Finding> {
    let path = dir.path.display();
    let own = "set PAIRMASK_RUNTIME_DIR to a directory of your own, on both sides";
    let (cause, cure) = match &dir.state {
        DirectoryState::Usable | DirectoryState::Missing => return None,
        DirectoryState::CannotBeMade => {
            (format!("{path} is not there, and you may not make it"), own.to_owned())
        }
        DirectoryState::NotWritable => {
            (format!("you may not write to {path}"), format!("chmod u+rwx {path}, or {own}"))
        }
        DirectoryState::Foreign { owner } => {
            (format!("{path} belongs to user {owner}, and not to you"), own.to_owned())
        }
        DirectoryState::Open { mode } => (
            format!(
                "{path} is open to other users (mode {mode:o}): they could change what is in it"
            ),
            format!("chmod 700 {path}, or {own}"),
        ),
        DirectoryState::NotADirectory => {
            (format!("{path} is no directory"), format!("remove it, or {own}"))
        }
        DirectoryState::Unreadable(why) => (format!("{path}: {why}"), own.to_owned()),
    };
    Some(Check::RuntimeDir.problem(cause, cure))
}

fn no_daemon(daemons: &Daemons, dir: &RuntimeDirectory) -> Option<Finding> {
    let Daemons { instance, found, elsewhere, foreign } = daemons;
    if found.iter().any(|daemon| daemon.state != State::Dead) {
        return None;
    }
    let (path, check) = (dir.path.display(), Check::Daemon);
    Some(match (elsewhere.first(), foreign) {
        (Some(other), _) => check.warning(
            format!("no daemon serves '{instance}' in {path}, and one of yours does in {}", other.display()),
            format!("set PAIRMASK_RUNTIME_DIR={} where clients run too", other.display()),
        ),
        (None, Some(user)) => check.warning(
            format!("user {user} serves '{instance}', and a daemon of another user is refused"),
            "start one as the user of the clients: `pairmaskd serve`",
        ),
        (None, None) => check.warning(
            format!("no daemon serves '{instance}' in {path}: clients with Backend::Auto answer by themselves"),
            "`pairmaskd serve`",
        ),
    })
}

fn silent_daemon(daemon: &Daemon) -> Option<Finding> {
    let Daemon { instance, process, problem, .. } = daemon;
    (daemon.state == State::Silent).then(|| {
        let cause = problem.clone();
        let cause = cause.unwrap_or_else(|| format!("instance '{instance}' does not answer"));
        let cure = format!("look at its log; where it does not recover, end process {process}: its supervisor starts another");
        Check::Daemon.problem(cause, cure)
    })
}

/// What holds in part, by an older kernel, is no finding.
fn fences(daemon: &Daemon) -> Option<Finding> {
    let fences = daemon.fences.filter(|_| daemon.state != State::Dead)?;
    let is_missing =
        |fence: &Fence| !matches!(fences.state(*fence), FenceState::Holds | FenceState::Partly);
    let missing: Vec<Fence> = Fence::ALL.into_iter().filter(is_missing).collect();
    let off = missing.iter().any(|fence| fences.state(*fence) == FenceState::Off);
    let cure = if off {
        "serve without --without-fence (PAIRMASK_WITHOUT_FENCE), unless a driver needs it"
    } else {
        "the kernel lacks it, or a container forbids it: Linux 6.12 has all of them"
    };
    (!missing.is_empty()).then(|| {
        let names = missing.iter().map(|fence| fence.as_str()).collect::<Vec<_>>().join(", ");
        let cause = format!("the worker of '{}' does without {names}", daemon.instance);
        Check::Fences.warning(cause, cure)
    })
}

fn left_files(facts: &Facts) -> Option<Finding> {
    let (count, bytes) = (facts.left.count, size_text(facts.left.bytes));
    let cause = || format!("processes that were killed left {count} files, {bytes}");
    (count > 0).then(|| Check::LeftFiles.warning(cause(), "`pairmaskd clean`"))
}

fn logout(logout: Logout) -> Option<Finding> {
    (logout.kills_processes && !logout.lingers).then(|| {
        Check::Logout.warning(
            "systemd ends your processes when you log out, a daemon too (KillUserProcesses=yes)",
            "`loginctl enable-linger`, and serve as a service of the user",
        )
    })
}

fn governor(governors: &[String]) -> Option<Finding> {
    governors.iter().any(|governor| governor == "powersave").then(|| {
        Check::Governor.warning(
            "cores lower their clocks between frames (governor powersave): short frames take longer",
            "`cpupower frequency-set -g performance`, where latency matters more than power",
        )
    })
}

/// Clocks that are read without a system call.
const QUICK_CLOCKS: [&str; 4] =
    ["tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter"];

fn clock(clock: Option<&str>) -> Option<Finding> {
    let slow = clock.filter(|clock| !QUICK_CLOCKS.contains(clock))?;
    Some(Check::Clock.warning(
        format!("each look at the clock is a system call (clocksource {slow}): waits and times cost more"),
        "boot with clocksource=tsc tsc=reliable, if the processor's counter is steady",
    ))
}

fn instruction_set(facts: &Facts) -> Option<Finding> {
    let (used, widest) = (facts.isa, facts.widest_isa);
    (used != widest).then(|| {
        Check::InstructionSet.warning(
            format!("engines are held to {used}, and this machine has {widest}"),
            "leave --isa out (PAIRMASK_ISA, isa of the configuration file)",
        )
    })
}

/// What a check sees, whatever it found.
pub fn seen(check: Check, facts: &Facts) -> String {
    let Facts { shm, memory, limits, runtime_dir, daemons, logout, .. } = facts;
    let or_none = |limit: Option<String>| limit.unwrap_or_else(|| "no limit".to_owned());
    match check {
        Check::Kernel => facts.kernel.map_or_else(
            || "unknown".to_owned(),
            |(major, minor)| format!("Linux {major}.{minor}"),
        ),
        Check::SharedMemory if !shm.is_there => "no /dev/shm".to_owned(),
        Check::SharedMemory if shm.total_bytes == 0 => "/dev/shm without a limit".to_owned(),
        Check::SharedMemory => {
            let (free, total) = (size_text(shm.free_bytes), size_text(shm.total_bytes));
            format!("/dev/shm has {free} free of {total}")
        }
        Check::Memory => {
            let usable = or_none(memory.usable_bytes.map(size_text));
            format!("{usable}; a daemon takes {} at most", size_text(memory.max_bytes))
        }
        Check::OpenFiles => {
            let limit = or_none(limits.files.map(|limit| limit.to_string()));
            format!("{limit}; {} clients need {}", limits.clients, limits.needed_files)
        }
        Check::AddressSpace => or_none(limits.address_space_bytes.map(size_text)),
        Check::RuntimeDir => {
            let is_new = runtime_dir.state == DirectoryState::Missing;
            let more = if is_new { ", which a daemon will make" } else { "" };
            format!("{}{more}", runtime_dir.path.display())
        }
        Check::Daemon => each(daemons, "none", |daemon| {
            format!("{} (process {})", format!("{:?}", daemon.state).to_lowercase(), daemon.process)
        }),
        Check::PidNamespace => each(daemons, "no daemon to be seen", |daemon| {
            let seen =
                if daemon.is_visible { "is seen" } else { "is in another one, which may be" };
            seen.to_owned()
        }),
        Check::Fences => each(daemons, "no daemon that has some", |daemon| {
            daemon.fences.map_or_else(|| "not known".to_owned(), fences_text)
        }),
        Check::LeftFiles if facts.left.count == 0 => "none".to_owned(),
        Check::LeftFiles => format!("{}, {}", facts.left.count, size_text(facts.left.bytes)),
        Check::Logout if logout.kills_processes => "KillUserProcesses=yes".to_owned(),
        Check::Logout if logout.removes_ipc => {
            "RemoveIPC=yes does no harm: memory in use has no name".to_owned()
        }
        Check::Logout => "nothing is removed".to_owned(),
        Check::Governor if facts.governors.is_empty() => "not for this system to choose".to_owned(),
        Check::Governor => facts.governors.join(", "),
        Check::Clock => facts.clock.clone().unwrap_or_else(|| "unknown".to_owned()),
        Check::InstructionSet => facts.isa.to_string(),
        Check::Vulkan => judge_gpus::seen_vulkan(&facts.gpu),
        Check::Gpu => judge_gpus::seen_gpus(&facts.gpu),
    }
}

/// Something of each daemon that lives.
fn each(daemons: &Daemons, none: &str, of: impl Fn(&Daemon) -> String) -> String {
    let living = daemons.found.iter().filter(|daemon| daemon.state != State::Dead);
    let texts: Vec<String> =
        living.map(|daemon| format!("'{}' {}", daemon.instance, of(daemon))).collect();
    if texts.is_empty() { none.to_owned() } else { texts.join("; ") }
}
