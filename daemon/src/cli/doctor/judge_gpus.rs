//! What keeps a daemon from its GPUs.

use std::path::{Path, PathBuf};

use super::facts::{DeviceFile, Gpus};
use super::judge::{Check, Finding};
use crate::cli::gpus::kind;
use crate::execute::gpu::{AdapterInfo, ListedGpu, choose, is_software};

/// What the loader needs to find drivers.
pub(super) fn vulkan(gpus: &Gpus) -> Option<Finding> {
    let check = Check::Vulkan;
    if gpus.choices.is_none() {
        return None;
    }
    if let Some((variable, missing)) = &gpus.named
        && let Some(file) = missing.first()
    {
        return Some(check.warning(
            format!(
                "{variable} names {}, which is no driver's file: none is found by it",
                file.display()
            ),
            format!("unset {variable}, or name the file of a driver"),
        ));
    }
    if gpus.device_files.is_empty() && gpus.choices.is_optional() {
        return None;
    }
    if !gpus.has_loader {
        let cause = "there is no Vulkan loader (libvulkan.so.1): no GPU can be opened";
        return Some(
            check.warning(cause, "install it: libvulkan1 of Debian, vulkan-loader of Fedora"),
        );
    }
    if gpus.drivers.is_empty() {
        return Some(check.warning(
            "no Vulkan driver is installed: no folder of the loader has a file for one",
            "install the vendor's driver, or mesa-vulkan-drivers for AMD and Intel",
        ));
    }
    let is_of_nvidia = |path: &Path| path.to_string_lossy().contains("nvidia");
    let is_nvidia = gpus.device_files.iter().any(|file| is_of_nvidia(&file.path));
    let has_its_driver = gpus.drivers.iter().any(|path| is_of_nvidia(path));
    (is_nvidia && !has_its_driver).then(|| {
        check.warning(
            "there is a GPU of NVIDIA's, and no Vulkan driver for it",
            "install nvidia's driver with Vulkan; for a container NVIDIA_DRIVER_CAPABILITIES=graphics,utility",
        )
    })
}

/// What the loader found, and what `--gpu` makes of it.
pub(super) fn gpus(gpus: &Gpus) -> Vec<Finding> {
    let Gpus { choices, device_files, adapters, .. } = gpus;
    if choices.is_none() {
        return Vec::new();
    }
    let check = Check::Gpu;
    let mut findings = Vec::new();
    let closed: Vec<&DeviceFile> = device_files.iter().filter(|file| !file.is_accessible).collect();
    if let Some(file) = closed.first() {
        findings.push(check.warning(
            format!("you may not open {}: its GPU is not found", file.path.display()),
            "join the group of that file (`ls -l` says which): `sudo usermod -aG render $USER`, then log in again",
        ));
    }
    let infos: Vec<AdapterInfo> = adapters.iter().map(|gpu| gpu.info.clone()).collect();
    // `all` takes what there is, as `auto` does.
    let named = if choices.is_optional() { Vec::new() } else { choices.each() };
    for choice in named.iter().filter(|choice| choose(choice, &infos).is_none()) {
        findings.push(check.problem(
            format!("no GPU fits '{choice}': a daemon would not start"),
            "`pairmaskd gpus` lists those that there are; --gpu auto does without (PAIRMASK_GPU)",
        ));
    }
    // Where something is missing, that is the cause.
    let is_explained = !closed.is_empty() || vulkan(gpus).is_some();
    let has_gpu = infos.iter().any(|info| !is_software(info));
    if let Some(file) = device_files.first().filter(|_| !has_gpu && !is_explained) {
        findings.push(check.warning(
            format!("there is {}, and no Vulkan driver finds a GPU: cores serve", file.path.display()),
            "install the driver of its vendor, in the version of the kernel's; VK_LOADER_DEBUG=error says what fails",
        ));
    }
    let copies = |gpu: &&ListedGpu| !is_software(&gpu.info) && !gpu.imports_host_memory;
    findings.extend(adapters.iter().filter(copies).map(|gpu| {
        check.warning(
            format!(
                "{} copies boxes and masks: its driver cannot import host memory",
                gpu.info.name
            ),
            "use a driver with VK_EXT_external_memory_host",
        )
    }));
    findings
}

pub(super) fn seen_vulkan(gpus: &Gpus) -> String {
    if gpus.choices.is_none() {
        return "not asked: --gpu none".to_owned();
    }
    let name = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        stem.replace("_icd", "")
    };
    let names: Vec<String> = gpus.drivers.iter().map(name).collect();
    let loader = if gpus.has_loader { "a loader" } else { "no loader" };
    let drivers = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    format!("{loader}; drivers: {drivers}")
}

pub(super) fn seen_gpus(gpus: &Gpus) -> String {
    if gpus.choices.is_none() {
        return "not asked: --gpu none".to_owned();
    }
    let text = |gpu: &ListedGpu| format!("{} ({})", gpu.info.name, kind(&gpu.info));
    let all: Vec<String> = gpus.adapters.iter().map(text).collect();
    if all.is_empty() { "none: cores serve".to_owned() } else { all.join(", ") }
}
