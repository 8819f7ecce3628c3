//! Machines of newcomers: each is named by what is wrong with it, and by nothing else.

use std::path::PathBuf;

use pairmask_core::engine::Isa;
use wgpu::{AdapterInfo, Backend, DeviceType};

use super::facts::{
    Daemon, Daemons, DeviceFile, DirectoryState, Facts, Gpus, LeftFiles, Limits, Logout, Memory,
    RuntimeDirectory, SharedMemory,
};
use super::judge::{Check, Finding, Level, judge, seen};
use super::{report, text};
use crate::cli::status::State;
use crate::execute::gpu::{GpuChoices, ListedGpu};
use crate::serve::fences::Fences;

const GIB: u64 = 1 << 30;
/// All fences hold; landlock holds in part; landlock is unavailable; rlimits are off.
const FENCES: [u32; 4] = [0x1111, 0x1121, 0x1131, 0x4111];

fn choices(text: &str) -> GpuChoices {
    text.parse().unwrap_or_default()
}

fn gpu(kind: DeviceType, imports_host_memory: bool) -> ListedGpu {
    let info = AdapterInfo { name: format!("{kind:?}"), ..AdapterInfo::new(kind, Backend::Vulkan) };
    ListedGpu { info, memory_bytes: None, imports_host_memory }
}

fn device_file(path: &str, is_accessible: bool) -> DeviceFile {
    DeviceFile { path: path.into(), is_accessible }
}

fn daemon(state: State, fences: u32) -> Daemon {
    let (instance, fences) = ("default".to_owned(), Fences::from_number(fences));
    Daemon { instance, state, problem: None, process: 7, is_visible: true, fences }
}

/// A machine with a GPU on which a daemon serves, and nothing is wrong.
fn healthy() -> Facts {
    Facts {
        kernel: Some((6, 12)),
        shm: SharedMemory {
            is_there: true,
            is_tmpfs: true,
            is_writable: true,
            total_bytes: 16 * GIB,
            free_bytes: 15 * GIB,
        },
        memory: Memory { usable_bytes: Some(32 * GIB), max_bytes: 21 * GIB },
        limits: Limits {
            files: Some(524_288),
            address_space_bytes: None,
            clients: 100,
            needed_files: 1728,
        },
        runtime_dir: RuntimeDirectory {
            path: "/run/user/1000/pairmask".into(),
            state: DirectoryState::Usable,
        },
        daemons: Daemons {
            instance: "default".into(),
            found: vec![daemon(State::Alive, FENCES[1])],
            elsewhere: Vec::new(),
            foreign: None,
        },
        left: LeftFiles::default(),
        logout: Logout { removes_ipc: true, ..Logout::default() },
        governors: vec!["schedutil".into()],
        clock: Some("tsc".into()),
        isa: Isa::Avx2,
        widest_isa: Isa::Avx2,
        gpu: Gpus {
            choices: choices("auto"),
            has_loader: true,
            named: None,
            drivers: vec!["/usr/share/vulkan/icd.d/radeon_icd.x86_64.json".into()],
            device_files: vec![device_file("/dev/dri/renderD128", true)],
            adapters: vec![gpu(DeviceType::Cpu, false), gpu(DeviceType::DiscreteGpu, true)],
        },
    }
}

#[test]
fn a_healthy_machine_has_no_finding() {
    let facts = healthy();
    assert_eq!(judge(&facts), []);
    let shown = text(&facts, &[]);
    assert!(shown.ends_with("\n0 problems, 0 warnings"), "{shown}");
    assert_eq!(shown.lines().count(), Check::ALL.len() + 1);
    for line in shown.lines().take(Check::ALL.len()) {
        assert!(line.starts_with("ok       ") && !line.ends_with(": "), "{line}");
    }
    // Nor one without a GPU, or in a container, or of a user who asks for none.
    let mut cores = healthy();
    cores.gpu = Gpus {
        has_loader: false,
        drivers: Vec::new(),
        device_files: Vec::new(),
        adapters: Vec::new(),
        ..cores.gpu
    };
    cores.runtime_dir.state = DirectoryState::Missing;
    cores.daemons.found[0].is_visible = false;
    cores.shm.total_bytes = 0;
    cores.shm.free_bytes = 0;
    cores.governors.clear();
    assert_eq!(judge(&cores), []);
    let mut none = healthy();
    none.gpu.choices = choices("none");
    none.gpu.has_loader = false;
    none.gpu.adapters.clear();
    assert_eq!(judge(&none), []);
}

/// A change to a healthy machine, the check that finds it, and a part of cause and cure.
type Broken = (fn(&mut Facts), Level, Check, &'static str, &'static str);

const BROKEN: [Broken; 35] = [
    (|m| m.kernel = Some((5, 10)), Level::Warning, Check::Kernel, "Linux 5.10", "5.14"),
    (
        |m| m.shm = SharedMemory::default(),
        Level::Problem,
        Check::SharedMemory,
        "no /dev/shm",
        "mount",
    ),
    (|m| m.shm.is_writable = false, Level::Problem, Check::SharedMemory, "not write", "chmod 1777"),
    (|m| m.shm.is_tmpfs = false, Level::Warning, Check::SharedMemory, "to a disk", "tmpfs"),
    (|m| m.shm.free_bytes = 1 << 20, Level::Problem, Check::SharedMemory, "is full", "free space"),
    (
        |m| (m.shm.total_bytes, m.shm.free_bytes) = (64 << 20, 64 << 20),
        Level::Warning,
        Check::SharedMemory,
        "is small: 64.0 MiB",
        "--shm-size",
    ),
    (
        |m| m.memory = Memory { usable_bytes: Some(2 * GIB), max_bytes: 8 * GIB },
        Level::Problem,
        Check::Memory,
        "may take 8.0 GiB, and this machine or control group has 2.0 GiB",
        "--max-memory",
    ),
    (
        |m| m.memory = Memory { usable_bytes: Some(GIB / 4), max_bytes: GIB / 8 },
        Level::Warning,
        Check::Memory,
        "has 256.0 MiB",
        "limit of the container",
    ),
    (
        |m| m.limits.files = Some(1024),
        Level::Problem,
        Check::OpenFiles,
        "100 clients need up to 1728 open files, and a process may have 1024",
        "--max-clients 56",
    ),
    (|m| m.limits.files = Some(64), Level::Problem, Check::OpenFiles, "may have 64", "LimitNOFILE"),
    (
        |m| m.limits.address_space_bytes = Some(4 * GIB),
        Level::Warning,
        Check::AddressSpace,
        "4.0 GiB of address space",
        "ulimit -v",
    ),
    (
        |m| m.runtime_dir.state = DirectoryState::Foreign { owner: 5 },
        Level::Problem,
        Check::RuntimeDir,
        "belongs to user 5",
        "PAIRMASK_RUNTIME_DIR",
    ),
    (
        |m| m.runtime_dir.state = DirectoryState::Open { mode: 0o777 },
        Level::Problem,
        Check::RuntimeDir,
        "mode 777",
        "chmod 700 /run/user/1000/pairmask",
    ),
    (
        |m| m.runtime_dir.state = DirectoryState::CannotBeMade,
        Level::Problem,
        Check::RuntimeDir,
        "may not make it",
        "of your own",
    ),
    (
        |m| m.runtime_dir.state = DirectoryState::NotADirectory,
        Level::Problem,
        Check::RuntimeDir,
        "no directory",
        "remove it",
    ),
    (
        |m| m.runtime_dir.state = DirectoryState::NotWritable,
        Level::Problem,
        Check::RuntimeDir,
        "may not write",
        "chmod u+rwx",
    ),
    (
        |m| m.daemons.found.clear(),
        Level::Warning,
        Check::Daemon,
        "no daemon serves 'default'",
        "pairmaskd serve",
    ),
    (
        |m| m.daemons.found = vec![daemon(State::Dead, FENCES[3])],
        Level::Warning,
        Check::Daemon,
        "no daemon serves",
        "pairmaskd serve",
    ),
    (
        |m| {
            m.daemons.found.clear();
            m.daemons.elsewhere = vec!["/tmp/pairmask-1000".into()];
        },
        Level::Warning,
        Check::Daemon,
        "one of yours does in /tmp/pairmask-1000",
        "PAIRMASK_RUNTIME_DIR=/tmp/pairmask-1000",
    ),
    (
        |m| {
            m.daemons.found.clear();
            m.daemons.foreign = Some(0);
        },
        Level::Warning,
        Check::Daemon,
        "user 0 serves",
        "as the user of the clients",
    ),
    (
        |m| {
            m.daemons.found[0].state = State::Silent;
            m.daemons.found[0].problem = Some("its heartbeat stands still".into());
        },
        Level::Problem,
        Check::Daemon,
        "stands still",
        "end process 7",
    ),
    (
        |m| m.daemons.found = vec![daemon(State::Alive, FENCES[2])],
        Level::Warning,
        Check::Fences,
        "does without landlock",
        "kernel",
    ),
    (
        |m| m.daemons.found = vec![daemon(State::Alive, FENCES[3])],
        Level::Warning,
        Check::Fences,
        "does without rlimits",
        "--without-fence",
    ),
    (
        |m| m.left = LeftFiles { count: 4, bytes: 20 << 20 },
        Level::Warning,
        Check::LeftFiles,
        "left 4 files, 20.0 MiB",
        "pairmaskd clean",
    ),
    (
        |m| m.logout.kills_processes = true,
        Level::Warning,
        Check::Logout,
        "when you log out",
        "enable-linger",
    ),
    (
        |m| m.governors = vec!["performance".into(), "powersave".into()],
        Level::Warning,
        Check::Governor,
        "powersave",
        "performance",
    ),
    (|m| m.clock = Some("hpet".into()), Level::Warning, Check::Clock, "hpet", "tsc"),
    (
        |m| (m.isa, m.widest_isa) = (Isa::Portable, Isa::Avx512),
        Level::Warning,
        Check::InstructionSet,
        "held to portable, and this machine has avx512",
        "PAIRMASK_ISA",
    ),
    (
        |m| {
            m.gpu.has_loader = false;
            m.gpu.adapters.clear();
        },
        Level::Warning,
        Check::Vulkan,
        "no Vulkan loader",
        "libvulkan1",
    ),
    (
        |m| {
            m.gpu.drivers.clear();
            m.gpu.adapters.clear();
        },
        Level::Warning,
        Check::Vulkan,
        "no Vulkan driver is installed",
        "mesa-vulkan-drivers",
    ),
    (
        |m| {
            m.gpu.device_files = vec![device_file("/dev/nvidia0", true)];
            m.gpu.adapters.truncate(1);
        },
        Level::Warning,
        Check::Vulkan,
        "GPU of NVIDIA's",
        "NVIDIA_DRIVER_CAPABILITIES",
    ),
    (
        |m| {
            m.gpu.named = Some(("VK_ICD_FILENAMES".into(), vec![PathBuf::from("/gone.json")]));
            m.gpu.drivers.clear();
            m.gpu.adapters.clear();
        },
        Level::Warning,
        Check::Vulkan,
        "VK_ICD_FILENAMES names /gone.json",
        "unset VK_ICD_FILENAMES",
    ),
    (
        |m| {
            m.gpu.device_files[0].is_accessible = false;
            m.gpu.adapters.truncate(1);
        },
        Level::Warning,
        Check::Gpu,
        "may not open /dev/dri/renderD128",
        "usermod -aG render",
    ),
    (
        |m| m.gpu.adapters.truncate(1),
        Level::Warning,
        Check::Gpu,
        "no Vulkan driver finds a GPU",
        "driver of its vendor",
    ),
    (
        |m| m.gpu.adapters[1].imports_host_memory = false,
        Level::Warning,
        Check::Gpu,
        "DiscreteGpu copies boxes",
        "VK_EXT_external_memory_host",
    ),
];

#[test]
fn each_broken_machine_is_named_by_what_is_wrong_with_it() {
    for (break_it, level, check, cause, cure) in BROKEN {
        let mut facts = healthy();
        break_it(&mut facts);
        let found = judge(&facts);
        let [finding] = &found[..] else { panic!("{cause}: {found:#?}") };
        assert_eq!((finding.level, finding.check), (level, check), "{finding:?}");
        assert!(finding.cause.contains(cause), "{cause}: {finding:?}");
        assert!(finding.cure.contains(cure), "{cure}: {finding:?}");
        assert!(text(&facts, &found).contains(&finding.cure));
    }
}

#[test]
fn a_gpu_that_is_named_and_not_there_is_a_problem() {
    let mut facts = healthy();
    facts.gpu.choices = choices("7,Discrete,GeForce");
    let found = judge(&facts);
    let is_problem = |finding: &Finding| finding.level == Level::Problem;
    assert!(found.len() == 2 && found.iter().all(is_problem), "{found:?}");
    assert!(found[0].cause.contains("'7'") && found[1].cause.contains("'GeForce'"), "{found:?}");
    facts.gpu.device_files.clear();
    facts.gpu.has_loader = false;
    facts.gpu.adapters.clear();
    let checks: Vec<Check> = judge(&facts).iter().map(|finding| finding.check).collect();
    assert_eq!(checks, [Check::Vulkan, Check::Gpu, Check::Gpu, Check::Gpu]);
}

#[test]
fn several_findings_stand_in_the_order_of_the_checks() {
    let mut facts = healthy();
    for (break_it, ..) in [BROKEN[35 - 2], BROKEN[8], BROKEN[0], BROKEN[6]] {
        break_it(&mut facts);
    }
    let found = judge(&facts);
    let checks: Vec<Check> = found.iter().map(|finding| finding.check).collect();
    assert_eq!(checks, [Check::Kernel, Check::Memory, Check::OpenFiles, Check::Gpu]);
    let report = report(&facts, &found);
    assert_eq!((&report["problems"], &report["warnings"]), (&2.into(), &2.into()));
    let checks = report["checks"].as_array().map_or(&[][..], Vec::as_slice);
    assert_eq!(checks.len(), Check::ALL.len());
    for (reported, check) in checks.iter().zip(Check::ALL) {
        let is_found = found.iter().any(|finding| finding.check == check);
        assert_eq!(reported["state"] == "ok", !is_found, "{reported}");
        assert_eq!(reported["seen"], seen(check, &facts));
        assert_eq!(reported["cure"].is_string(), is_found, "{reported}");
    }
    assert_eq!(checks[3]["check"], "open-files");
    assert_eq!(checks[3]["state"], "problem");
}
