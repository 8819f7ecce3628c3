//! Reads what `doctor` judges. What cannot be read counts as healthy: a doctor that may not look finds nothing.

use std::collections::BTreeSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use pairmask_core::engine::Isa;
use pairmask_core::usable_memory;
use pairmask_transport::{RuntimeDir, foreign_owner, instance_sockets, left_files, process_name};
use pairmask_wire::{InstanceError, InstanceName};
use rustix::fs::{Access, AtFlags, CWD, StatVfs, accessat, statfs, statvfs};
use rustix::process::{Resource, geteuid, getrlimit};

use super::facts::{
    Daemon, Daemons, DeviceFile, DirectoryState, Facts, Gpus, LeftFiles, Limits, Logout, Memory,
    RuntimeDirectory, SharedMemory,
};
use crate::cli::options::CommonOptions;
use crate::cli::status::{Instance, instances};
use crate::execute::gpu::{GpuChoices, has_vulkan_loader, list_gpus};
use crate::path_in;
use crate::serve::fences::Fences;
use crate::serve::{FILES_PER_CLIENT, OWN_FILES};

/// What `serve` would be set to by the same flags, variables and file.
#[derive(Clone, Debug)]
pub struct Serving {
    pub max_clients: usize,
    pub max_memory_bytes: u64,
    pub gpus: GpuChoices,
}

pub fn read(common: &CommonOptions, serving: &Serving) -> Facts {
    let dir = common.runtime_dir();
    Facts {
        kernel: kernel(),
        shm: shared_memory(),
        memory: Memory {
            usable_bytes: usable_memory::bytes(),
            max_bytes: serving.max_memory_bytes,
        },
        limits: Limits {
            files: getrlimit(Resource::Nofile).maximum,
            address_space_bytes: getrlimit(Resource::As).current,
            clients: serving.max_clients,
            needed_files: OWN_FILES + FILES_PER_CLIENT * serving.max_clients as u64,
        },
        runtime_dir: runtime_dir(&dir),
        daemons: daemons(&dir, common.named_instance()),
        left: left(&dir),
        logout: logout(),
        governors: governors(),
        clock: line("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        isa: common.isa().get(),
        widest_isa: Isa::best(),
        gpu: gpus(serving.gpus.clone()),
    }
}

/// The first line of a small file of the system's.
fn line(path: impl AsRef<Path>) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    Some(text.lines().next()?.trim().to_owned())
}

/// Files of a folder whose names fit, sorted.
fn files(folder: impl AsRef<Path>, is_one: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let fit = entries.filter(|entry| entry.file_name().to_str().is_some_and(&is_one));
    let mut found: Vec<PathBuf> = fit.map(|entry| entry.path()).collect();
    found.sort();
    found
}

fn ends_in(name: &str, extension: &str) -> bool {
    Path::new(name).extension().is_some_and(|found| found == extension)
}

fn may(path: &Path, access: Access) -> bool {
    accessat(CWD, path, access, AtFlags::EACCESS).is_ok()
}

fn kernel() -> Option<(u32, u32)> {
    let release = line("/proc/sys/kernel/osrelease")?;
    let mut numbers = release.split(|c: char| !c.is_ascii_digit()).map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

/// `f_type` of a file system in memory, by `statfs(2)`.
const TMPFS_MAGIC: u64 = 0x0102_1994;

fn shared_memory() -> SharedMemory {
    let path = Path::new("/dev/shm");
    let space = statvfs(path).ok();
    let bytes = |blocks: fn(&StatVfs) -> u64| {
        space.as_ref().map_or(0, |of| blocks(of).saturating_mul(of.f_frsize))
    };
    SharedMemory {
        is_there: path.is_dir(),
        is_tmpfs: statfs(path).is_ok_and(|of| u64::try_from(of.f_type) == Ok(TMPFS_MAGIC)),
        is_writable: may(path, Access::WRITE_OK),
        total_bytes: bytes(|of| of.f_blocks),
        free_bytes: bytes(|of| of.f_bavail),
    }
}

fn runtime_dir(dir: &RuntimeDir) -> RuntimeDirectory {
    let path = dir.path().to_owned();
    let state = match dir.check() {
        Ok(()) if may(&path, Access::WRITE_OK) => DirectoryState::Usable,
        Ok(()) => DirectoryState::NotWritable,
        Err(InstanceError::Foreign { owner, .. }) => DirectoryState::Foreign { owner },
        Err(InstanceError::Open { mode, .. }) => DirectoryState::Open { mode },
        Err(InstanceError::NotPlain { .. }) => DirectoryState::NotADirectory,
        Err(InstanceError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
            let around = path.ancestors().skip(1).find(|around| around.exists());
            match around {
                Some(around) if !may(around, Access::WRITE_OK) => DirectoryState::CannotBeMade,
                _ => DirectoryState::Missing,
            }
        }
        Err(error) => DirectoryState::Unreadable(error.to_string()),
    };
    RuntimeDirectory { path, state }
}

fn daemons(dir: &RuntimeDir, named: Option<InstanceName>) -> Daemons {
    let found = instances(dir, named.as_ref()).into_iter().map(daemon).collect();
    let name = named.unwrap_or_default();
    let looked_in: Vec<PathBuf> = dir.all().map(|dir| dir.path().to_owned()).collect();
    let is_elsewhere = |other: &RuntimeDir| {
        // A command's own daemon is none that clients shall find.
        let is_private = other.path().file_name().is_some_and(|name| {
            name.as_encoded_bytes().starts_with(crate::spawn::DIR_PREFIX.as_bytes())
        });
        !is_private && other.check().is_ok() && !looked_in.iter().any(|dir| dir == other.path())
    };
    let sockets = instance_sockets().into_iter().filter(|(_, served)| *served == name);
    let mut elsewhere: Vec<PathBuf> = sockets
        .filter(|(other, _)| is_elsewhere(other))
        .map(|(other, _)| other.path().to_owned())
        .collect();
    elsewhere.sort();
    elsewhere.dedup();
    Daemons { foreign: foreign_owner(&name), instance: name.to_string(), found, elsewhere }
}

fn daemon(instance: Instance) -> Daemon {
    let Instance { name, record, state, problem, .. } = instance;
    Daemon {
        instance: name.to_string(),
        state,
        problem,
        process: record.worker_pid,
        is_visible: process_name(record.worker_pid) == "pairmaskd",
        fences: Fences::from_number(record.fences),
    }
}

fn left(dir: &RuntimeDir) -> LeftFiles {
    let files = left_files(dir);
    LeftFiles { count: files.len(), bytes: files.iter().map(|file| file.bytes).sum() }
}

/// Users below this are the system's, whom systemd's logind leaves alone.
const FIRST_USER: u32 = 1000;

fn logout() -> Logout {
    let user = geteuid().as_raw();
    let files = files("/etc/systemd/logind.conf.d", |name| ends_in(name, "conf"));
    let texts = [PathBuf::from("/etc/systemd/logind.conf")].into_iter().chain(files);
    let texts: Vec<String> = texts.filter_map(|path| fs::read_to_string(path).ok()).collect();
    // The last one counts.
    let value = |key: &str| {
        let lines = texts.iter().flat_map(|text| text.lines()).rev();
        let mut values = lines.filter_map(|line| line.split_once('='));
        values.find(|(name, _)| name.trim() == key).map(|(_, value)| value.trim().to_owned())
    };
    let is_yes = |key: &str, default: bool| {
        value(key).map_or(default, |value| ["yes", "true", "on", "1"].contains(&value.as_str()))
    };
    let has_logind = Path::new("/run/systemd/seats").exists();
    Logout {
        kills_processes: has_logind && is_yes("KillUserProcesses", false),
        removes_ipc: has_logind && user >= FIRST_USER && is_yes("RemoveIPC", true),
        lingers: user < FIRST_USER || has_lingering_name(user),
    }
}

/// Whether the user's name is among those that `loginctl enable-linger` knows.
fn has_lingering_name(user: u32) -> bool {
    let names = fs::read_to_string("/etc/passwd").unwrap_or_default();
    let mut entries = names.lines().map(|line| line.split(':').collect::<Vec<_>>());
    let entry = entries.find(|entry| entry.get(2) == Some(&user.to_string().as_str()));
    let name = entry.and_then(|entry| entry.first().copied());
    name.is_some_and(|name| Path::new("/var/lib/systemd/linger").join(name).exists())
}

fn governors() -> Vec<String> {
    let policies = files("/sys/devices/system/cpu/cpufreq", |name| name.starts_with("policy"));
    let governors = policies.iter().filter_map(|policy| line(policy.join("scaling_governor")));
    let mut found: Vec<String> = governors.collect();
    found.sort();
    found.dedup();
    found
}

/// Variables that name drivers in place of the system's folders; the loader reads the first one that is set.
const DRIVER_VARIABLES: [&str; 2] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];
/// Folders where the loader looks for drivers, and `vulkan/icd.d` below those of `$XDG_DATA_DIRS`.
const DRIVER_FOLDERS: [&str; 4] = ["/usr/local/etc", "/etc", "/usr/local/share", "/usr/share"];

fn gpus(choices: GpuChoices) -> Gpus {
    let variable = DRIVER_VARIABLES.into_iter().find_map(|name| Some((name, path_in(name)?)));
    let (drivers, named) = match variable {
        None => (installed_drivers(), None),
        Some((name, value)) => {
            // A folder stands for the files in it.
            let paths = std::env::split_paths(&value);
            let (drivers, missing) = paths.partition(|path| path.is_file() || path.is_dir());
            (drivers, Some((name.to_owned(), missing)))
        }
    };
    let is_asked = !choices.is_none();
    Gpus {
        has_loader: is_asked && has_vulkan_loader(),
        named,
        drivers,
        device_files: device_files(),
        adapters: if is_asked { list_gpus() } else { Vec::new() },
        choices,
    }
}

fn installed_drivers() -> Vec<PathBuf> {
    let more = path_in("XDG_DATA_DIRS").unwrap_or_default();
    let folders = DRIVER_FOLDERS.map(PathBuf::from).into_iter();
    let folders: BTreeSet<PathBuf> = folders.chain(std::env::split_paths(&more)).collect();
    let is_one = |name: &str| ends_in(name, "json");
    folders.iter().flat_map(|folder| files(folder.join("vulkan/icd.d"), is_one)).collect()
}

fn device_files() -> Vec<DeviceFile> {
    let is_nvidia = |name: &str| {
        let number = name.strip_prefix("nvidia").unwrap_or_default();
        !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())
    };
    let nodes = files("/dev/dri", |name| name.starts_with("renderD"));
    let all = nodes.into_iter().chain(files("/dev", is_nvidia));
    let file = |path: PathBuf| DeviceFile {
        is_accessible: may(&path, Access::READ_OK | Access::WRITE_OK),
        path,
    };
    all.map(file).collect()
}
