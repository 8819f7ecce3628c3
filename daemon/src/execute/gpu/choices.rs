//! Which GPUs a daemon uses: one, or several.

use std::fmt;
use std::str::FromStr;

use super::adapter::{AdapterInfo, GpuChoice, best_of_kind, list_adapters};

/// The user's choice of GPUs: choices of one each, with commas between them, or `all`.
///
/// ```
/// use pairmaskd::execute::gpu::{GpuChoice, GpuChoices};
/// assert_eq!("auto".parse(), Ok(GpuChoices::default()));
/// assert_eq!("0,1".parse(), Ok(GpuChoices::Each(vec![GpuChoice::Index(0), GpuChoice::Index(1)])));
/// assert_eq!("all".parse(), Ok(GpuChoices::All));
/// ```
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
    /// Whether no GPU is wanted.
    pub fn is_none(&self) -> bool {
        matches!(self, Self::Each(choices) if choices.iter().all(|choice| *choice == GpuChoice::None))
    }

    /// Whether a daemon that finds none of them serves without a GPU.
    pub fn is_optional(&self) -> bool {
        *self == Self::All || *self == Self::default()
    }

    /// A choice for each device.
    pub fn each(&self) -> Vec<GpuChoice> {
        match self {
            Self::Each(choices) => {
                choices.iter().filter(|choice| **choice != GpuChoice::None).cloned().collect()
            }
            Self::All => all_of(&list_adapters()),
        }
    }

    /// The first of them, for what uses one GPU.
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
    let choice = |place: usize| match &adapters[place].pci_address {
        address if address.is_empty() => GpuChoice::Index(place),
        address => GpuChoice::Name(address.clone()),
    };
    let all: Vec<GpuChoice> = best_of_kind(adapters).map(choice).collect();
    if all.is_empty() { vec![GpuChoice::Auto] } else { all }
}

#[cfg(test)]
mod tests {
    use super::super::adapter::AdapterKind;
    use super::*;

    fn adapter(name: &str, pci_address: &str, kind: AdapterKind) -> AdapterInfo {
        AdapterInfo {
            name: name.into(),
            driver: String::new(),
            pci_address: pci_address.into(),
            vendor_id: 0,
            device_id: 0,
            kind,
        }
    }

    #[test]
    fn choices_read_as_they_are_written() {
        for text in ["auto", "none", "all", "0,1", "software,software", "NVIDIA H200,0000:02:00.0"]
        {
            let choices: GpuChoices = text.parse().unwrap_or_default();
            assert_eq!(choices.to_string(), text);
        }
        assert_eq!("0, 1".parse::<GpuChoices>().map(|all| all.to_string()), Ok("0,1".into()));
    }

    #[test]
    fn none_is_no_device() {
        let choices = |text: &str| text.parse::<GpuChoices>().unwrap_or_default();
        assert!(choices("none").is_none() && choices("none").each().is_empty());
        assert_eq!(choices("none,software").each(), [GpuChoice::Software]);
        assert!(!choices("none,software").is_none() && !choices("auto").is_none());
        assert!(choices("auto").is_optional() && choices("all").is_optional());
        assert!(!choices("0").is_optional() && !choices("auto,auto").is_optional());
        assert_eq!(choices("1,0").first(), GpuChoice::Index(1));
        assert_eq!(choices("all").first(), GpuChoice::Auto);
    }

    #[test]
    fn all_takes_every_adapter_of_the_best_kind() {
        let big = |address: &str| adapter("big", address, AdapterKind::Discrete);
        let software = adapter("llvmpipe", "", AdapterKind::Software);
        let small = adapter("small", "0:0", AdapterKind::Integrated);
        let all = [software.clone(), small.clone(), big("0:1"), big("")];
        assert_eq!(all_of(&all), [GpuChoice::Name("0:1".into()), GpuChoice::Index(3)]);
        assert_eq!(all_of(&all[..2]), [GpuChoice::Name("0:0".into())]);
        assert_eq!(all_of(&[software]), [GpuChoice::Auto], "which finds none, and says so");
    }
}
