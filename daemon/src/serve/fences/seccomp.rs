//! Seccomp: the system calls that the worker may not make.
//!
//! It is a list of what is denied. The worker loads drivers of GPUs, most of them closed, of any version, above any C
//! library: a list of what is allowed would be that of the drivers that we measured, and a GPU of another would be lost
//! on its user's machine, at the call that its new version makes. What a process may do harm with is known: start
//! programs and processes, reach into other processes, into the network and the user's services, change rights,
//! file systems or the kernel. Calls that are newer than the list do not exist for the worker (ENOSYS): libraries
//! have an answer to that, since they run on older kernels.
//!
//! A call that is denied fails with EPERM. Drivers try things, and do without: killing the worker would lose its
//! clients' scenes. Only a call by another architecture's table ends the process, as no honest code makes one.
//!
//! `unsafe` for the one system call that installs the filter, with flags that `seccompiler` does not set.
#![allow(unsafe_code)]

use std::collections::BTreeMap;
use std::env::consts::ARCH;
use std::io;

use seccompiler::{
    BackendError, BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition,
    SeccompFilter, SeccompRule, sock_filter,
};

use super::{FenceError, FenceState};

/// What becomes of a call that is denied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    Fails,
    /// It is made, and the kernel logs its number (`type=1326`), to see what a driver misses:
    /// `PAIRMASK_SECCOMP_LOG=1`. The fence counts as off. Calls that do not exist for the worker still do not.
    Logged,
}

/// Denied regardless of their arguments.
const DENIED: &[libc::c_long] = &[
    // Programs.
    libc::SYS_execve,
    libc::SYS_execveat,
    // Other processes: their memory, files, signals.
    libc::SYS_ptrace,
    libc::SYS_process_vm_readv,
    libc::SYS_process_vm_writev,
    libc::SYS_process_madvise,
    libc::SYS_process_mrelease,
    libc::SYS_kcmp,
    libc::SYS_pidfd_getfd,
    libc::SYS_pidfd_send_signal,
    libc::SYS_tkill,
    // Rights.
    libc::SYS_setuid,
    libc::SYS_setgid,
    libc::SYS_setreuid,
    libc::SYS_setregid,
    libc::SYS_setresuid,
    libc::SYS_setresgid,
    libc::SYS_setfsuid,
    libc::SYS_setfsgid,
    libc::SYS_setgroups,
    libc::SYS_capset,
    libc::SYS_add_key,
    libc::SYS_request_key,
    libc::SYS_keyctl,
    // Namespaces and file systems.
    libc::SYS_setns,
    libc::SYS_chroot,
    libc::SYS_pivot_root,
    libc::SYS_mount,
    libc::SYS_umount2,
    libc::SYS_mount_setattr,
    libc::SYS_move_mount,
    libc::SYS_open_tree,
    libc::SYS_fsopen,
    libc::SYS_fsconfig,
    libc::SYS_fsmount,
    libc::SYS_fspick,
    libc::SYS_mknodat,
    libc::SYS_name_to_handle_at,
    libc::SYS_open_by_handle_at,
    libc::SYS_fanotify_init,
    libc::SYS_quotactl,
    libc::SYS_quotactl_fd,
    libc::SYS_swapon,
    libc::SYS_swapoff,
    // The kernel, and the parts of it that attacks go through.
    libc::SYS_init_module,
    libc::SYS_finit_module,
    libc::SYS_delete_module,
    libc::SYS_kexec_load,
    libc::SYS_kexec_file_load,
    libc::SYS_reboot,
    libc::SYS_bpf,
    libc::SYS_perf_event_open,
    libc::SYS_userfaultfd,
    libc::SYS_syslog,
    libc::SYS_acct,
    libc::SYS_vhangup,
    libc::SYS_personality,
    libc::SYS_nfsservctl,
    libc::SYS_sethostname,
    libc::SYS_setdomainname,
    libc::SYS_settimeofday,
    libc::SYS_clock_settime,
    libc::SYS_clock_adjtime,
    libc::SYS_adjtimex,
    // It makes other calls without passing this filter.
    libc::SYS_io_uring_setup,
    libc::SYS_io_uring_enter,
    libc::SYS_io_uring_register,
];

/// As [`DENIED`], of this architecture alone.
#[cfg(target_arch = "x86_64")]
const DENIED_HERE: &[libc::c_long] = &[
    libc::SYS_fork,
    libc::SYS_vfork,
    libc::SYS_mknod,
    libc::SYS_iopl,
    libc::SYS_ioperm,
    libc::SYS_modify_ldt,
];
#[cfg(not(target_arch = "x86_64"))]
const DENIED_HERE: &[libc::c_long] = &[];

/// Flags of namespaces, of which a process is made its own. Threads of drivers unshare other things.
const NAMESPACES: [libc::c_int; 8] = [
    libc::CLONE_NEWCGROUP,
    libc::CLONE_NEWIPC,
    libc::CLONE_NEWNET,
    libc::CLONE_NEWNS,
    libc::CLONE_NEWPID,
    libc::CLONE_NEWTIME,
    libc::CLONE_NEWUSER,
    libc::CLONE_NEWUTS,
];

/// Requests that put text into a terminal as if it were typed.
#[allow(clippy::unnecessary_cast)] // The type is another one in other C libraries.
const TYPING: [u64; 2] = [libc::TIOCSTI as u64, libc::TIOCLINUX as u64];

/// The last call that this list was made with. Numbers above it are those of newer calls, and of the table of x32.
const LAST_KNOWN: libc::c_long = libc::SYS_mseal;

/// The kind of a socket, beside flags.
const SOCKET_KIND: u64 = 0xf;

pub(super) fn raise(refusal: Refusal) -> Result<FenceState, FenceError> {
    install(&program(refusal)?)?;
    Ok(match refusal {
        Refusal::Fails => FenceState::Holds,
        Refusal::Logged => FenceState::Off,
    })
}

/// A condition on an argument, of which 32 bits count.
type Condition = (u8, SeccompCmpOp, u64);

/// Calls that are denied where all conditions of one of their rules hold.
fn conditions() -> [(libc::c_long, Vec<Vec<Condition>>); 8] {
    use SeccompCmpOp::{Eq, MaskedEq, Ne};
    let own = u64::from(std::process::id());
    let namespaces: Vec<_> =
        NAMESPACES.map(|flag| vec![(0, MaskedEq(flag as u64), flag as u64)]).into();
    let (thread, unix) = (libc::CLONE_THREAD as u64, libc::AF_UNIX as u64);
    [
        // A process. How a thread is started differs by a flag.
        (libc::SYS_clone, [vec![vec![(0, MaskedEq(thread), 0)]], namespaces.clone()].concat()),
        (libc::SYS_unshare, namespaces),
        // The network; and streams, by which a user's services are reached: the session's bus, which starts programs,
        // the agent with keys, the display.
        (
            libc::SYS_socket,
            vec![vec![(0, Ne, unix)], vec![(1, MaskedEq(SOCKET_KIND), libc::SOCK_STREAM as u64)]],
        ),
        // What would be typed into the terminal that the daemon was started from.
        (libc::SYS_ioctl, TYPING.map(|request| vec![(1, Eq, request)]).into()),
        // Signals to others.
        (libc::SYS_kill, vec![vec![(0, Ne, own)]]),
        (libc::SYS_tgkill, vec![vec![(0, Ne, own)]]),
        (libc::SYS_rt_sigqueueinfo, vec![vec![(0, Ne, own)]]),
        (libc::SYS_rt_tgsigqueueinfo, vec![vec![(0, Ne, own)]]),
    ]
}

fn program(refusal: Refusal) -> Result<BpfProgram, BackendError> {
    let denied = match refusal {
        Refusal::Fails => SeccompAction::Errno(libc::EPERM as u32),
        Refusal::Logged => SeccompAction::Log,
    };
    let mut rules: BTreeMap<i64, Vec<SeccompRule>> = BTreeMap::new();
    rules.extend(DENIED.iter().chain(DENIED_HERE).map(|call| (*call, Vec::new())));
    for (call, alternatives) in conditions() {
        let rule = |conditions: Vec<Condition>| {
            let condition = |(argument, is, value)| {
                SeccompCondition::new(argument, SeccompCmpArgLen::Dword, is, value)
            };
            SeccompRule::new(conditions.into_iter().map(condition).collect::<Result<_, _>>()?)
        };
        rules.insert(call, alternatives.into_iter().map(rule).collect::<Result<_, _>>()?);
    }
    let filter = SeccompFilter::new(rules, SeccompAction::Allow, denied, ARCH.try_into()?)?;
    let mut program = of_missing_calls().to_vec();
    program.extend(BpfProgram::try_from(filter)?);
    Ok(program)
}

/// The head of the program, for calls that do not exist for the worker. Newer ones; and `clone3`, whose flags
/// are in memory, where no filter can read them: C libraries start threads by `clone` without it.
fn of_missing_calls() -> [sock_filter; 4] {
    let action = SeccompAction::Errno(libc::ENOSYS as u32);
    let instruction =
        |code: u32, [jt, jf]: [u8; 2], k| sock_filter { code: code as u16, jt, jf, k };
    let compare = libc::BPF_JMP | libc::BPF_K;
    [
        // The number is the first word of what a filter is shown.
        instruction(libc::BPF_LD | libc::BPF_W | libc::BPF_ABS, [0; 2], 0),
        instruction(compare | libc::BPF_JEQ, [1, 0], libc::SYS_clone3 as u32),
        instruction(compare | libc::BPF_JGT, [0, 1], LAST_KNOWN as u32),
        instruction(libc::BPF_RET | libc::BPF_K, [0; 2], action.into()),
    ]
}

/// Installs a filter for all threads of the process.
///
/// Without `SPEC_ALLOW`, kernels before 5.16 also switch off speculation past stores, which costs engines more than the
/// filter protects.
fn install(program: &[sock_filter]) -> io::Result<()> {
    rustix::thread::set_no_new_privs(true)?;
    let raw = |i: &sock_filter| libc::sock_filter { code: i.code, jt: i.jt, jf: i.jf, k: i.k };
    let mut filter: Vec<libc::sock_filter> = program.iter().map(raw).collect();
    let len = u16::try_from(filter.len()).map_err(io::Error::other)?;
    let program = libc::sock_fprog { len, filter: filter.as_mut_ptr() };
    let flags = libc::SECCOMP_FILTER_FLAG_TSYNC | libc::SECCOMP_FILTER_FLAG_SPEC_ALLOW;
    // SAFETY: the kernel copies `len` instructions of `filter`, which outlives the call, and writes nothing.
    let done = unsafe {
        libc::syscall(libc::SYS_seccomp, libc::SECCOMP_SET_MODE_FILTER, flags, &raw const program)
    };
    match done {
        0 => Ok(()),
        -1 => Err(io::Error::last_os_error()),
        thread => Err(io::Error::other(format!("thread {thread} has a filter of its own"))),
    }
}
