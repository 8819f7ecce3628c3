//! Which GPU: the list of adapters and the choice among them.

use std::fmt;
use std::str::FromStr;

use super::error::OpenError;

/// The user's choice of GPU.
///
/// ```
/// use pairmaskd::execute::gpu::GpuChoice;
/// assert_eq!("auto".parse(), Ok(GpuChoice::Auto));
/// assert_eq!("1".parse(), Ok(GpuChoice::Index(1)));
/// assert_eq!("H200".parse(), Ok(GpuChoice::Name("H200".into())));
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum GpuChoice {
    /// The best real GPU; never a software adapter, which the CPU engines beat.
    #[default]
    Auto,
    /// No GPU.
    None,
    /// A software adapter, for tests.
    Software,
    /// The adapter at this place in the list.
    Index(usize),
    /// The first adapter whose name contains this text, or whose PCI address it is.
    Name(String),
}

impl FromStr for GpuChoice {
    type Err = std::convert::Infallible;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        Ok(match s {
            "auto" => Self::Auto,
            "none" => Self::None,
            "software" => Self::Software,
            _ => s.parse().map_or_else(|_| Self::Name(s.to_owned()), Self::Index),
        })
    }
}

impl fmt::Display for GpuChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::None => f.write_str("none"),
            Self::Software => f.write_str("software"),
            Self::Index(index) => index.fmt(f),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// What an adapter is, as far as the choice needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// Runs on the CPU.
    Software,
    /// Neither of the others: virtual or unknown.
    Other,
    /// Shares memory with the CPU.
    Integrated,
    /// Has memory of its own.
    Discrete,
}

/// One adapter of the list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// Marketing name.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// PCI address, `domain:bus:device.function`; empty when it has none.
    pub pci_address: String,
    /// PCI vendor.
    pub vendor_id: u32,
    /// PCI device.
    pub device_id: u32,
    /// Kind of adapter.
    pub kind: AdapterKind,
}

impl AdapterInfo {
    /// Runs on the CPU.
    pub fn is_software(&self) -> bool {
        self.kind == AdapterKind::Software
    }

    /// Whether both are the same device by the same driver: then the same shader computes the same bits on both.
    pub fn computes_as(&self, other: &Self) -> bool {
        (self.vendor_id, self.device_id, &self.driver)
            == (other.vendor_id, other.device_id, &other.driver)
    }
}

impl From<wgpu::AdapterInfo> for AdapterInfo {
    fn from(info: wgpu::AdapterInfo) -> Self {
        Self {
            kind: match info.device_type {
                wgpu::DeviceType::Cpu => AdapterKind::Software,
                wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
                wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
                wgpu::DeviceType::VirtualGpu | wgpu::DeviceType::Other => AdapterKind::Other,
            },
            driver: format!("{} {}", info.driver, info.driver_info),
            name: info.name,
            pci_address: info.device_pci_bus_id,
            vendor_id: info.vendor,
            device_id: info.device,
        }
    }
}

/// Place in `adapters` of the one that `choice` means. Pure, so that it is tested without a GPU.
pub fn choose(choice: &GpuChoice, adapters: &[AdapterInfo]) -> Option<usize> {
    let places = || adapters.iter().enumerate();
    match choice {
        GpuChoice::None => None,
        GpuChoice::Auto => best_of_kind(adapters).next(),
        GpuChoice::Software => places().find(|(_, a)| a.is_software()).map(|(place, _)| place),
        GpuChoice::Index(index) => (*index < adapters.len()).then_some(*index),
        GpuChoice::Name(name) => places()
            .find(|(_, a)| a.name.contains(name.as_str()) || a.pci_address == *name)
            .map(|(place, _)| place),
    }
}

/// Places of the adapters of the best kind that there is; never of software.
pub(super) fn best_of_kind(adapters: &[AdapterInfo]) -> impl Iterator<Item = usize> {
    let best = adapters.iter().map(|a| a.kind).max();
    let best = best.filter(|kind| *kind != AdapterKind::Software);
    (0..adapters.len()).filter(move |place| Some(adapters[*place].kind) == best)
}

/// The Vulkan adapters of this machine.
pub(super) struct AdapterList {
    pub(super) infos: Vec<AdapterInfo>,
    adapters: Vec<wgpu::Adapter>,
}

impl AdapterList {
    /// Asks the Vulkan loader; empty without one.
    pub(super) fn find() -> Self {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::VULKAN;
        // No validation layers: they are slow, and the stages are validated by naga.
        descriptor.flags = wgpu::InstanceFlags::empty();
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        let infos = adapters.iter().map(|a| a.get_info().into()).collect();
        Self { infos, adapters }
    }

    /// The adapter that `choice` means.
    pub(super) fn take(
        mut self,
        choice: &GpuChoice,
    ) -> Result<(wgpu::Adapter, AdapterInfo), OpenError> {
        if *choice == GpuChoice::None {
            return Err(OpenError::SwitchedOff);
        }
        match choose(choice, &self.infos) {
            Some(place) => Ok((self.adapters.swap_remove(place), self.infos.swap_remove(place))),
            None => Err(OpenError::NoAdapter {
                choice: choice.clone(),
                available: self.infos.into_iter().map(|a| a.name).collect(),
            }),
        }
    }
}

/// The Vulkan adapters of this machine, in the order that [`GpuChoice::Index`] counts.
pub fn list_adapters() -> Vec<AdapterInfo> {
    AdapterList::find().infos
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, kind: AdapterKind) -> AdapterInfo {
        AdapterInfo {
            name: name.into(),
            driver: String::new(),
            pci_address: format!("pci-{name}"),
            vendor_id: 0,
            device_id: 0,
            kind,
        }
    }

    #[test]
    fn devices_compute_alike_that_are_the_same_by_the_same_driver() {
        let one = adapter("one", AdapterKind::Discrete);
        assert!(one.computes_as(&adapter("another", AdapterKind::Discrete)));
        let others = [
            AdapterInfo { vendor_id: 1, ..one.clone() },
            AdapterInfo { device_id: 1, ..one.clone() },
            AdapterInfo { driver: "1.2".into(), ..one.clone() },
        ];
        assert!(others.iter().all(|other| !one.computes_as(other)));
    }

    #[test]
    fn auto_takes_the_first_of_the_best_kind_and_never_software() {
        let software = adapter("llvmpipe", AdapterKind::Software);
        let small = adapter("small", AdapterKind::Integrated);
        let big = adapter("big", AdapterKind::Discrete);
        let all = [software.clone(), small, big.clone(), big];
        assert_eq!(choose(&GpuChoice::Auto, &all), Some(2));
        assert_eq!(choose(&GpuChoice::Auto, &[software]), None);
        assert_eq!(choose(&GpuChoice::Software, &all), Some(0));
        assert_eq!(choose(&GpuChoice::None, &all), None);
    }

    #[test]
    fn index_and_name_and_pci_address_choose_any() {
        let all =
            [adapter("llvmpipe", AdapterKind::Software), adapter("big", AdapterKind::Discrete)];
        assert_eq!(choose(&GpuChoice::Index(1), &all), Some(1));
        assert_eq!(choose(&GpuChoice::Index(2), &all), None);
        assert_eq!(choose(&GpuChoice::Name("llvm".into()), &all), Some(0));
        assert_eq!(choose(&GpuChoice::Name("pci-big".into()), &all), Some(1));
        assert_eq!(choose(&GpuChoice::Name("other".into()), &all), None);
    }

    #[test]
    fn choices_read_as_they_are_written() {
        for text in ["auto", "none", "software", "3", "NVIDIA H200"] {
            let choice: GpuChoice = text.parse().unwrap_or_default();
            assert_eq!(choice.to_string(), text);
        }
    }
}
