//! Which GPU: the list of adapters and the choice among them.

use std::fmt;
use std::str::FromStr;

use wgpu::{AdapterInfo, DeviceType};

use super::OpenError;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum GpuChoice {
    /// The best real GPU; never a software adapter, which the CPU engines beat.
    #[default]
    Auto,
    None,
    /// A software adapter, for tests.
    Software,
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

pub fn is_software(adapter: &AdapterInfo) -> bool {
    adapter.device_type == DeviceType::Cpu
}

/// Whether both are the same device by the same driver: then the same shader computes the same bits on both.
pub fn compute_alike(one: &AdapterInfo, other: &AdapterInfo) -> bool {
    (one.vendor, one.device, &one.driver, &one.driver_info)
        == (other.vendor, other.device, &other.driver, &other.driver_info)
}

/// Place in `adapters` of the one that `choice` means. Pure, so that it is tested without a GPU.
pub fn choose(choice: &GpuChoice, adapters: &[AdapterInfo]) -> Option<usize> {
    let slots = || adapters.iter().enumerate();
    match choice {
        GpuChoice::None => None,
        GpuChoice::Auto => best_of_kind(adapters).next(),
        GpuChoice::Software => slots().find(|(_, a)| is_software(a)).map(|(put, _)| put),
        GpuChoice::Index(index) => (*index < adapters.len()).then_some(*index),
        GpuChoice::Name(name) => slots()
            .find(|(_, a)| a.name.contains(name.as_str()) || a.device_pci_bus_id == *name)
            .map(|(put, _)| put),
    }
}

/// Places of the adapters of the best kind that there is; never of software.
pub(super) fn best_of_kind(adapters: &[AdapterInfo]) -> impl Iterator<Item = usize> {
    let rank = |adapter: &AdapterInfo| match adapter.device_type {
        DeviceType::Cpu => 0,
        DeviceType::VirtualGpu | DeviceType::Other => 1,
        DeviceType::IntegratedGpu => 2,
        DeviceType::DiscreteGpu => 3,
    };
    let best = adapters.iter().map(rank).max().filter(|rank| *rank > 0);
    (0..adapters.len()).filter(move |put| Some(rank(&adapters[*put])) == best)
}

/// Asks the Vulkan loader; empty without one.
pub(super) fn find_adapters() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN;
    // No validation layers: they are slow, and the stages are validated by naga.
    descriptor.flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
}

pub(super) fn find_adapter(choice: &GpuChoice) -> Result<wgpu::Adapter, OpenError> {
    if *choice == GpuChoice::None {
        return Err(OpenError::SwitchedOff);
    }
    let mut adapters = find_adapters();
    let infos: Vec<_> = adapters.iter().map(wgpu::Adapter::get_info).collect();
    match choose(choice, &infos) {
        Some(put) => Ok(adapters.swap_remove(put)),
        None => Err(OpenError::NoAdapter {
            choice: choice.clone(),
            available: infos.into_iter().map(|a| a.name).collect(),
        }),
    }
}

/// The Vulkan adapters of this machine, in the order that [`GpuChoice::Index`] counts.
pub fn list_adapters() -> Vec<AdapterInfo> {
    find_adapters().iter().map(wgpu::Adapter::get_info).collect()
}

/// The user's choice of GPUs: choices of one each, with commas between them, or `all`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GpuChoices {
    /// One device for each of these. A software adapter that is named twice is opened twice.
    Each(Vec<GpuChoice>),
    /// All GPUs of the best kind: those among which `auto` takes the first.
    All,
}

impl Default for GpuChoices {
    fn default() -> Self {
        GpuChoice::default().into()
    }
}

impl From<GpuChoice> for GpuChoices {
    fn from(choice: GpuChoice) -> Self {
        Self::Each(vec![choice])
    }
}

impl FromStr for GpuChoices {
    type Err = std::convert::Infallible;

    fn from_str(s: &str) -> Result<Self, Self::Err> {
        let choice = |text: &str| text.trim().parse().unwrap_or_default();
        Ok(if s == "all" { Self::All } else { Self::Each(s.split(',').map(choice).collect()) })
    }
}

impl fmt::Display for GpuChoices {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all"),
            Self::Each(choices) => choices.iter().enumerate().try_for_each(|(at, choice)| {
                f.write_str(if at == 0 { "" } else { "," })?;
                choice.fmt(f)
            }),
        }
    }
}

impl GpuChoices {
    pub fn is_none(&self) -> bool {
        matches!(self, Self::Each(choices) if choices.iter().all(|choice| *choice == GpuChoice::None))
    }

    /// Whether a daemon that finds none of them serves without a GPU.
    pub fn is_optional(&self) -> bool {
        *self == Self::All || *self == Self::default()
    }

    pub fn each(&self) -> Vec<GpuChoice> {
        match self {
            Self::Each(choices) => {
                choices.iter().filter(|choice| **choice != GpuChoice::None).cloned().collect()
            }
            Self::All => all_of(&list_adapters()),
        }
    }

    pub fn first(&self) -> GpuChoice {
        match self {
            Self::Each(choices) => choices.first().cloned().unwrap_or_default(),
            Self::All => GpuChoice::Auto,
        }
    }
}

/// A choice for each adapter of the best kind; `auto` where there is none, which says so. By PCI address
/// where they have one: places in the list may change while one is away.
fn all_of(adapters: &[AdapterInfo]) -> Vec<GpuChoice> {
    let choice = |put: usize| match &adapters[put].device_pci_bus_id {
        address if address.is_empty() => GpuChoice::Index(put),
        address => GpuChoice::Name(address.clone()),
    };
    let all: Vec<GpuChoice> = best_of_kind(adapters).map(choice).collect();
    if all.is_empty() { vec![GpuChoice::Auto] } else { all }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, pci_address: &str, kind: DeviceType) -> AdapterInfo {
        let (name, device_pci_bus_id) = (name.into(), pci_address.into());
        AdapterInfo { name, device_pci_bus_id, ..AdapterInfo::new(kind, wgpu::Backend::Vulkan) }
    }

    #[test]
    fn devices_compute_alike_that_are_the_same_by_the_same_driver() {
        let one = adapter("one", "", DeviceType::DiscreteGpu);
        assert!(compute_alike(&one, &adapter("another", "0:1", DeviceType::DiscreteGpu)));
        let others = [
            AdapterInfo { vendor: 1, ..one.clone() },
            AdapterInfo { device: 1, ..one.clone() },
            AdapterInfo { driver: "nv".into(), ..one.clone() },
            AdapterInfo { driver_info: "1.2".into(), ..one.clone() },
        ];
        assert!(others.iter().all(|other| !compute_alike(&one, other)));
    }

    #[test]
    fn each_choice_finds_its_adapter_and_auto_never_software() {
        let big = |address: &str| adapter("big", address, DeviceType::DiscreteGpu);
        let software = adapter("llvmpipe", "", DeviceType::Cpu);
        let all =
            [software, adapter("small", "0:0", DeviceType::IntegratedGpu), big("0:1"), big("")];
        for (text, expected) in [
            ("auto", Some(2)),
            ("software", Some(0)),
            ("none", None),
            ("1", Some(1)),
            ("4", None),
            ("llvm", Some(0)),
            ("0:1", Some(2)),
            ("other", None),
        ] {
            assert_eq!(choose(&text.parse().unwrap_or_default(), &all), expected, "{text}");
        }
        assert_eq!(choose(&GpuChoice::Auto, &all[..1]), None);
        assert_eq!(all_of(&all), [GpuChoice::Name("0:1".into()), GpuChoice::Index(3)]);
        assert_eq!(all_of(&all[..2]), [GpuChoice::Name("0:0".into())]);
        assert_eq!(all_of(&all[..1]), [GpuChoice::Auto], "which finds none, and says so");
    }

    #[test]
    fn choices_read_as_they_are_written_and_none_is_no_device() {
        let choices = |text: &str| text.parse::<GpuChoices>().unwrap_or_default();
        for text in ["auto", "none", "3", "all", "0,1", "software,software", "NVIDIA,0000:02:00.0"]
        {
            assert_eq!(choices(text).to_string(), text);
        }
        assert_eq!(choices("0, 1").to_string(), "0,1");
        assert!(choices("none").is_none() && choices("none").each().is_empty());
        assert_eq!(choices("none,software").each(), [GpuChoice::Software]);
        assert!(!choices("none,software").is_none() && !choices("auto").is_none());
        assert!(choices("auto").is_optional() && choices("all").is_optional());
        assert!(!choices("0").is_optional() && !choices("auto,auto").is_optional());
        assert_eq!(choices("1,0").first(), GpuChoice::Index(1));
        assert_eq!(choices("all").first(), GpuChoice::Auto);
    }
}
