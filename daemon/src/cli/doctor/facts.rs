//! What `doctor` knows of a machine: plain data, so that tests make machines.

use std::path::PathBuf;

use pairmask_core::engine::Isa;

use crate::cli::status::State;
use crate::execute::gpu::{GpuChoices, ListedGpu};
use crate::serve::fences::Fences;

#[derive(Clone, Debug)]
pub struct Facts {
    /// Major and minor version of Linux; `None` where it has another form.
    pub kernel: Option<(u32, u32)>,
    pub shm: SharedMemory,
    pub memory: Memory,
    pub limits: Limits,
    /// The directory that a daemon would take.
    pub runtime_dir: RuntimeDirectory,
    pub daemons: Daemons,
    pub left: LeftFiles,
    pub logout: Logout,
    /// Governors of the cores' clocks, each once; none where the machine has no such choice.
    pub governors: Vec<String>,
    /// The kernel's clock.
    pub clock: Option<String>,
    pub isa: Isa,
    pub widest_isa: Isa,
    pub gpu: Gpus,
}

/// /dev/shm.
#[derive(Clone, Debug, Default)]
pub struct SharedMemory {
    pub is_there: bool,
    pub is_tmpfs: bool,
    pub is_writable: bool,
    /// 0 without a limit.
    pub total_bytes: u64,
    pub free_bytes: u64,
}

#[derive(Clone, Copy, Debug)]
pub struct Memory {
    /// What a process may have: of the machine, or of its control group.
    pub usable_bytes: Option<u64>,
    /// What `serve` would take at most.
    pub max_bytes: u64,
}

/// Hard limits of this process, `None` without one.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub files: Option<u64>,
    pub address_space_bytes: Option<u64>,
    /// Clients that `serve` would let in.
    pub clients: usize,
    /// Open files that so many need.
    pub needed_files: u64,
}

#[derive(Clone, Debug)]
pub struct RuntimeDirectory {
    pub path: PathBuf,
    pub state: DirectoryState,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DirectoryState {
    Usable,
    /// There is none, and a daemon makes it.
    Missing,
    /// There is none, and this user may not make it.
    CannotBeMade,
    NotWritable,
    Foreign {
        /// Who it, or a part of its path, belongs to.
        owner: u32,
    },
    /// Others may write to it.
    Open {
        mode: u32,
    },
    NotADirectory,
    Unreadable(String),
}

#[derive(Clone, Debug, Default)]
pub struct Daemons {
    /// The instance that is meant where only one is.
    pub instance: String,
    pub found: Vec<Daemon>,
    /// Directories where this user serves the instance and clients do not look.
    pub elsewhere: Vec<PathBuf>,
    /// Another user who serves the instance.
    pub foreign: Option<u32>,
}

#[derive(Clone, Debug)]
pub struct Daemon {
    pub instance: String,
    pub state: State,
    pub problem: Option<String>,
    pub process: u32,
    /// Whether that is the id of a `pairmaskd` here: it is not in another PID namespace.
    pub is_visible: bool,
    /// `None` of an earlier version.
    pub fences: Option<Fences>,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct LeftFiles {
    pub count: usize,
    pub bytes: u64,
}

/// What systemd does when the user logs out.
#[derive(Clone, Copy, Debug, Default)]
pub struct Logout {
    pub kills_processes: bool,
    pub removes_ipc: bool,
    /// Whether the user's services outlive the last session, or it is a user of the system: then nothing of it is ended.
    pub lingers: bool,
}

#[derive(Clone, Debug)]
pub struct Gpus {
    pub choices: GpuChoices,
    pub has_loader: bool,
    /// Variable that names the drivers, in place of the system's folders, and what it names that is no driver's file.
    pub named: Option<(String, Vec<PathBuf>)>,
    /// Files by which the loader finds drivers.
    pub drivers: Vec<PathBuf>,
    pub device_files: Vec<DeviceFile>,
    /// What the loader finds; nothing where no GPU is asked for.
    pub adapters: Vec<ListedGpu>,
}

#[derive(Clone, Debug)]
pub struct DeviceFile {
    pub path: PathBuf,
    pub is_accessible: bool,
}
