//! The encodings that a daemon can be asked for: an older daemon knows fewer.

use std::sync::atomic::{AtomicBool, Ordering};

use pairmask_core::mask::{EncodingChoice, ReadableEncodings};
use pairmask_wire::Version;

/// The encodings that the daemon of a connection knows.
#[derive(Debug)]
pub(super) struct KnownEncodings {
    known: ReadableEncodings,
    /// Whether the log says that the daemon chooses the encoding.
    reported: AtomicBool,
}

impl KnownEncodings {
    /// The encodings of a daemon, by the version that it states.
    pub(super) fn of(version: Version) -> Self {
        Self { known: ReadableEncodings::at_minor(version.minor), reported: AtomicBool::new(false) }
    }

    /// The choice that the daemon can be sent: an older daemon is left to choose where it does not
    /// know the encoding asked for, which is logged once.
    pub(super) fn agree(&self, asked: EncodingChoice) -> EncodingChoice {
        match asked {
            EncodingChoice::Only(encoding) if !self.known.contains(encoding) => {
                if !self.reported.swap(true, Ordering::Relaxed) {
                    log::warn!(
                        "the daemon does not know {encoding} masks: it chooses the encoding"
                    );
                }
                EncodingChoice::Auto
            }
            _ => asked,
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::mask::Encoding;

    use super::*;

    #[test]
    fn an_older_daemon_is_asked_for_no_encoding_that_it_does_not_know() {
        for minor in 0..5 {
            let known = KnownEncodings::of(Version { minor, ..Version::CURRENT });
            for encoding in Encoding::ALL {
                let asked = EncodingChoice::Only(encoding);
                let knows = encoding != Encoding::List || minor >= 3;
                let agreed = if knows { asked } else { EncodingChoice::Auto };
                assert_eq!(known.agree(asked), agreed, "{encoding}, 1.{minor}");
            }
            assert_eq!(known.agree(EncodingChoice::Auto), EncodingChoice::Auto);
        }
    }
}
