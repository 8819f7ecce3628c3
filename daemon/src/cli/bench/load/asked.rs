//! What a load consists of, as the command line says it.

use std::fmt;
use std::num::NonZeroU32;
use std::str::FromStr;

/// The highest rate, Hz: a frame every 10 µs, which is shorter than any frame.
const MOST_HERTZ: u32 = 100_000;
/// The most clients at a time: each is a process, and takes a slot of the daemon.
const MOST_CLIENTS: u32 = 256;

/// Frames a second of one client, 1 to 100,000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hertz(NonZeroU32);

/// How a client asks for its frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// Each frame when the one before it is done.
    Closed,
    /// Each frame at its time, whatever became of the one before it.
    Paced(Hertz),
}

/// A number of clients at a time, 1 to 256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientCount(NonZeroU32);

/// Clients of one size among clients of differing sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MixPart {
    /// Boxes of each.
    pub n: u32,
    /// How many.
    pub clients: ClientCount,
}

/// Why a text is no rate, count or mix.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AskedError {
    /// Not a rate.
    #[error("must be a whole number of Hz from 1 to {MOST_HERTZ}, or closed")]
    Rate,
    /// Not a number of clients.
    #[error("must be a whole number of clients from 1 to {MOST_CLIENTS}")]
    Clients,
    /// Not a size and a number of clients.
    #[error(
        "must be boxes x clients, such as 1000x7 for seven clients of 1,000 boxes, with 1 to \
         {MOST_CLIENTS} clients"
    )]
    Mix,
    /// The parts of a mix are too many together.
    #[error("--mix has {clients} clients: leave some out, {MOST_CLIENTS} are the most")]
    TooMany {
        /// Clients of all parts.
        clients: u32,
    },
}

/// A number from 1 to `most`, in digits alone.
fn number(text: &str, most: u32) -> Option<NonZeroU32> {
    let is_plain = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let parsed = is_plain.then(|| text.parse::<NonZeroU32>().ok()).flatten()?;
    (parsed.get() <= most).then_some(parsed)
}

impl Hertz {
    /// Frames a second.
    pub const fn get(self) -> u32 {
        self.0.get()
    }
}

impl FromStr for Hertz {
    type Err = AskedError;

    fn from_str(text: &str) -> Result<Self, AskedError> {
        number(text, MOST_HERTZ).map(Self).ok_or(AskedError::Rate)
    }
}

impl FromStr for Rate {
    type Err = AskedError;

    fn from_str(text: &str) -> Result<Self, AskedError> {
        if text == "closed" { Ok(Self::Closed) } else { text.parse().map(Self::Paced) }
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Closed => f.write_str("closed"),
            Self::Paced(hertz) => hertz.get().fmt(f),
        }
    }
}

impl ClientCount {
    /// One client.
    pub const ONE: Self = Self(NonZeroU32::MIN);

    /// How many.
    pub const fn get(self) -> u32 {
        self.0.get()
    }
}

impl FromStr for ClientCount {
    type Err = AskedError;

    fn from_str(text: &str) -> Result<Self, AskedError> {
        number(text, MOST_CLIENTS).map(Self).ok_or(AskedError::Clients)
    }
}

impl FromStr for MixPart {
    type Err = AskedError;

    fn from_str(text: &str) -> Result<Self, AskedError> {
        let (n, clients) = text.split_once('x').ok_or(AskedError::Mix)?;
        let n = if n == "0" { Some(0) } else { number(n, u32::MAX).map(NonZeroU32::get) };
        let clients = clients.parse().map_err(|_| AskedError::Mix)?;
        Ok(Self { n: n.ok_or(AskedError::Mix)?, clients })
    }
}

/// The clients of all parts of a mix.
///
/// # Errors
/// [`AskedError::TooMany`].
pub fn clients_of(mix: &[MixPart]) -> Result<u32, AskedError> {
    let clients = mix.iter().fold(0, |sum: u32, part| sum.saturating_add(part.clients.get()));
    if clients <= MOST_CLIENTS { Ok(clients) } else { Err(AskedError::TooMany { clients }) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn rates_and_counts_are_whole_numbers_within_bounds() {
        assert_eq!("closed".parse(), Ok(Rate::Closed));
        for text in ["1", "60", "100000"] {
            let rate: Rate = text.parse().unwrap();
            assert_eq!(rate.to_string(), text);
        }
        for text in ["", "0", "-1", "+60", "59.94", "100001", "60Hz", "4294967296", "open"] {
            assert_eq!(text.parse::<Rate>(), Err(AskedError::Rate), "{text}");
        }
        assert_eq!("256".parse::<ClientCount>().map(ClientCount::get), Ok(256));
        for text in ["0", "257", "many", "", "99999999999"] {
            assert_eq!(text.parse::<ClientCount>(), Err(AskedError::Clients), "{text}");
        }
    }

    #[test]
    fn a_mix_has_sizes_and_numbers_of_clients() {
        let part = |text: &str| text.parse::<MixPart>();
        let found = part("1000x7").unwrap();
        assert_eq!((found.n, found.clients.get()), (1000, 7));
        assert_eq!(part("0x1").map(|part| part.n), Ok(0));
        for text in ["", "x", "1000", "1000x", "x7", "1000x0", "-1x1", "1000x7x1", "4294967296x1"] {
            assert_eq!(part(text), Err(AskedError::Mix), "{text}");
        }
        assert_eq!(clients_of(&[found, part("5x249").unwrap()]), Ok(256));
        let most = part("5x256").unwrap();
        assert_eq!(clients_of(&[most, found]), Err(AskedError::TooMany { clients: 263 }));
    }
}
