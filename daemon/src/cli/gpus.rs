//! `gpus`: what `--gpu` can name on this machine.

use std::fmt::Write;

use clap::Args;
use serde_json::{Value, json};
use wgpu::{AdapterInfo, DeviceType};

use super::output::{print_json, print_text, size_text};
use super::program::Result;
use super::progress::spinner;
use crate::execute::gpu::{GpuChoice, ListedGpu, choose, list_gpus};

/// Show the GPUs that --gpu can name
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd gpus                       number, kind, name, driver and memory
  pairmaskd gpus --json
  pairmaskd serve --gpu 1              by its number, a part of its name or its PCI address

A number may change when a driver is installed; a PCI address does not.")]
pub struct Gpus {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Gpus {
    pub fn run(&self) -> Result {
        let progress = spinner("GPUs");
        let gpus = list_gpus();
        progress.finish_and_clear();
        let infos: Vec<AdapterInfo> = gpus.iter().map(|gpu| gpu.info.clone()).collect();
        let auto = choose(&GpuChoice::Auto, &infos);
        if self.json {
            let gpus = gpus.iter().enumerate();
            let all: Vec<Value> = gpus.map(|(at, gpu)| report(at, gpu, auto)).collect();
            print_json(&json!({ "gpus": all }))?;
        } else {
            print_text(text(&gpus, auto).trim_end())?;
        }
        Ok(())
    }
}

pub(super) const fn kind(gpu: &AdapterInfo) -> &'static str {
    match gpu.device_type {
        DeviceType::DiscreteGpu => "discrete",
        DeviceType::IntegratedGpu => "integrated",
        DeviceType::VirtualGpu => "virtual",
        DeviceType::Cpu => "software",
        DeviceType::Other => "other",
    }
}

/// An element of `gpus` of `gpus --json`, whose fields `CLI.md` explains. Fields may be added, never changed or taken
/// away.
fn report(at: usize, gpu: &ListedGpu, auto: Option<usize>) -> Value {
    let ListedGpu { info, memory_bytes, imports_host_memory } = gpu;
    let address = &info.device_pci_bus_id;
    json!({
        "number": at,
        "name": info.name,
        "kind": kind(info),
        "driver": driver(info),
        "backend": info.backend.to_str(),
        "pci_address": (!address.is_empty()).then_some(address),
        "memory_bytes": memory_bytes,
        "imports_host_memory": imports_host_memory,
        "auto": auto == Some(at),
    })
}

fn driver(gpu: &AdapterInfo) -> String {
    format!("{} {}", gpu.driver, gpu.driver_info).trim().to_owned()
}

fn text(gpus: &[ListedGpu], auto: Option<usize>) -> String {
    if gpus.is_empty() {
        return "no GPU: is a Vulkan driver installed?".to_owned();
    }
    let mut text = String::new();
    for (at, gpu) in gpus.iter().enumerate() {
        let ListedGpu { info, memory_bytes, imports_host_memory } = gpu;
        let is_auto = if auto == Some(at) { ", taken by --gpu auto" } else { "" };
        let memory = memory_bytes.map(|bytes| format!(", {}", size_text(bytes)));
        let address = match info.device_pci_bus_id.as_str() {
            "" => String::new(),
            address => format!(", PCI {address}"),
        };
        let copies = if *imports_host_memory { "" } else { ", copies boxes and masks" };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{at}: {}, {}{is_auto}", info.name, kind(info));
        let _ = writeln!(
            text,
            "   {} by {}{address}{}{copies}",
            info.backend,
            driver(info),
            memory.unwrap_or_default()
        );
    }
    if auto.is_none() {
        text.push_str("--gpu auto takes none of them: cores are faster than a software adapter\n");
    }
    text
}
