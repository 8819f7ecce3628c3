//! Landlock: the files that the worker may read or write, and no TCP.
//!
//! It may read where systems keep drivers and what these look at, and write to shared memory, to the directory of its
//! instance, to the caches of compiled pipelines and to the files of GPUs. All else, the user's home before all, is
//! closed to it. It may run no file. Paths that do not exist when the fence is raised are left out: a GPU whose file
//! appears later needs another worker.

use std::path::PathBuf;

use ::landlock::{
    ABI, Access, AccessFs, AccessNet, BitFlags, LandlockStatus, Ruleset, RulesetAttr,
    RulesetCreatedAttr, RulesetStatus, Scope, make_bitflags, path_beneath_rules,
};

use super::{FenceError, FenceState, paths_in};
use crate::execute::gpu::user_cache_folder;
use crate::serve::ServeSettings;

/// What is asked for. A kernel that has less of it gives what it has: Linux 5.13 files, 6.7 TCP, 6.12 signals and
/// abstract sockets, and one with this version the sockets of other services.
const VERSION: ABI = ABI::V9;

/// Where systems keep drivers, their settings, and what a kernel says of itself.
const READ: [&str; 10] = [
    "/usr",
    "/lib",
    "/lib64",
    "/opt",
    "/nix/store",
    "/run/opengl-driver",
    "/etc",
    "/proc",
    "/sys",
    "/dev/urandom",
];
/// Variables by which a user names drivers that are kept elsewhere.
const READ_VARIABLES: [&str; 4] =
    ["LD_LIBRARY_PATH", "VK_DRIVER_FILES", "VK_ADD_DRIVER_FILES", "VK_ICD_FILENAMES"];
/// Files of GPUs in /dev begin so: render nodes, those of NVIDIA, Tegra, AMD, Mali, and of WSL.
const DEVICES: [&str; 8] = ["dri", "nvidia", "nvhost", "nvmap", "nvgpu", "kfd", "mali", "dxg"];
/// Variables by which drivers are given a directory for what they compile: Mesa's, NVIDIA's.
const CACHE_VARIABLES: [&str; 2] = ["MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH"];

/// The environment of a worker whose drivers keep their caches in our own directory: theirs are in the user's home,
/// under names that change from version to version. One that the user has set stays.
pub fn driver_caches() -> impl Iterator<Item = (&'static str, PathBuf)> {
    let folder = user_cache_folder();
    let unset = CACHE_VARIABLES.into_iter().filter(|name| std::env::var_os(name).is_none());
    unset.filter_map(move |name| Some((name, folder.clone()?)))
}

pub(super) fn raise(settings: &ServeSettings) -> Result<FenceState, FenceError> {
    let has_gpus = !settings.daemon.gpu.is_none();
    let (gpus, caches) = if has_gpus { (gpus(), caches()) } else { Default::default() };
    let read = make_bitflags!(AccessFs::{ReadFile | ReadDir});
    let device = read | AccessFs::WriteFile | AccessFs::IoctlDev;
    let files = make_bitflags!(AccessFs::{
        MakeReg | MakeDir | MakeSym | RemoveFile | RemoveDir | Refer | Truncate
    });
    let write: BitFlags<AccessFs> = read | AccessFs::WriteFile | files;
    let write_here = write | AccessFs::MakeSock | AccessFs::ResolveUnix;
    let status = Ruleset::default()
        .handle_access(AccessFs::from_all(VERSION))?
        .handle_access(AccessNet::from_all(VERSION))?
        .scope(Scope::from_all(VERSION))?
        .create()?
        .add_rules(path_beneath_rules(READ, read))?
        .add_rules(path_beneath_rules(READ_VARIABLES.into_iter().flat_map(paths_in), read))?
        .add_rules(path_beneath_rules(["/dev/null", "/dev/zero"], device))?
        .add_rules(path_beneath_rules(gpus, device))?
        .add_rules(path_beneath_rules(["/dev/shm"], write))?
        .add_rules(path_beneath_rules(caches, write))?
        .add_rules(path_beneath_rules([settings.dir.path()], write_here))?
        .restrict_self()?;
    Ok(match status.ruleset {
        RulesetStatus::FullyEnforced => FenceState::Holds,
        RulesetStatus::PartiallyEnforced => {
            log::info!("the fence landlock holds in part: {}", kernels(status.landlock));
            FenceState::Partly
        }
        RulesetStatus::NotEnforced => {
            log::info!("serving without the fence landlock: {}", kernels(status.landlock));
            FenceState::Unavailable
        }
    })
}

fn kernels(status: LandlockStatus) -> String {
    match status {
        LandlockStatus::Available { effective_abi, .. } => {
            format!("this kernel has version {effective_abi} of {VERSION}")
        }
        LandlockStatus::NotEnabled => "this kernel was started without it".into(),
        LandlockStatus::NotImplemented => "this kernel does not have it".into(),
    }
}

/// The files of GPUs that there are.
fn gpus() -> Vec<PathBuf> {
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let is_gpu = |name: &[u8]| DEVICES.iter().any(|device| name.starts_with(device.as_bytes()));
    let gpus = entries.filter(|entry| is_gpu(entry.file_name().as_encoded_bytes()));
    gpus.map(|entry| entry.path()).collect()
}

/// Where pipelines are kept: by us, and by drivers.
fn caches() -> Vec<PathBuf> {
    let of_drivers = CACHE_VARIABLES.into_iter().flat_map(paths_in);
    let caches: Vec<PathBuf> = user_cache_folder().into_iter().chain(of_drivers).collect();
    for cache in &caches {
        // Without one, pipelines are compiled anew.
        let _ = std::fs::create_dir_all(cache);
    }
    caches
}
