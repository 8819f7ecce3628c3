//! The forms of objects that a daemon can be sent: an older daemon knows fewer.

use std::sync::atomic::{AtomicBool, AtomicU16, AtomicU64, Ordering};

use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::{BoxForm, Precision};
use pairmask_wire::{FRAME_RULES_MINOR, Version, since_minor};

use super::written::Written;

/// The forms of objects that the daemon of a connection knows.
#[derive(Debug)]
pub(super) struct KnownForms {
    /// The minor wire version up to which the daemon knows forms.
    minor: AtomicU16,
    /// Whether the log says that frames are exact.
    reported_exact: AtomicBool,
    /// The minor versions, a bit each, of which the log says that such frames are answered in process.
    reported_stay: AtomicU64,
}

impl KnownForms {
    /// The forms of a daemon, by the version that it states.
    pub(super) const fn of(version: Version) -> Self {
        Self {
            minor: AtomicU16::new(version.minor),
            reported_exact: AtomicBool::new(false),
            reported_stay: AtomicU64::new(0),
        }
    }

    /// Whether the daemon knows what a minor version added.
    pub(super) fn knows(&self, since_minor: u16) -> bool {
        since_minor <= self.minor.load(Ordering::Relaxed)
    }

    /// Logs once that frames with what a minor version added are answered in process.
    pub(super) fn say_stay(&self, since_minor: u16, what: &'static str) {
        let reported = 1 << (since_minor % u64::BITS as u16);
        if self.reported_stay.fetch_or(reported, Ordering::Relaxed) & reported == 0 {
            log::warn!("the daemon does not know {what}: their frames are answered in process");
        }
    }

    /// The precision that the daemon can be sent: an older daemon gets exact boxes, which is logged
    /// once.
    pub(super) fn agree(&self, asked: Precision) -> Precision {
        if self.knows(since_minor(asked.form().into())) {
            return asked;
        }
        self.say_exact(asked.form());
        Precision::Exact
    }

    /// Notes that the daemon refused a frame with rules, whatever version it stated: what their version
    /// and later ones added is not sent again.
    pub(super) fn note_refused_rules(&self) {
        self.minor.fetch_min(FRAME_RULES_MINOR - 1, Ordering::Relaxed);
    }

    /// Notes that the daemon refused how a frame was written, whatever version it stated: that and
    /// what later versions added are not sent again.
    pub(super) fn note_refused(&self, written: Written) {
        let Some(before) = written.since_minor().checked_sub(1) else { return };
        self.minor.fetch_min(before, Ordering::Relaxed);
        if let ObjectForm::Boxes(form) = written.form
            && form.is_narrow()
        {
            self.say_exact(form);
        }
    }

    fn say_exact(&self, form: BoxForm) {
        if !self.reported_exact.swap(true, Ordering::Relaxed) {
            log::warn!("the daemon does not know {form} boxes: frames are exact");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_knows_the_forms_up_to_it() {
        let [old, narrow, new] =
            [0, 1, 2].map(|minor| KnownForms::of(Version { minor, ..Version::CURRENT }));
        for form in ObjectForm::ALL {
            let since = since_minor(form);
            assert!(new.knows(since), "{form}");
            assert_eq!(narrow.knows(since), form != ObjectForm::Spheres, "{form}");
            assert_eq!(old.knows(since), form == BoxForm::F32.into(), "{form}");
        }
    }

    #[test]
    fn rules_that_were_refused_are_not_sent_again_and_forms_are() {
        let known = KnownForms::of(Version::CURRENT);
        assert!(known.knows(FRAME_RULES_MINOR));
        known.note_refused_rules();
        assert!(!known.knows(FRAME_RULES_MINOR) && known.knows(FRAME_RULES_MINOR - 1));
        assert_eq!(known.agree(Precision::F16), Precision::F16);
    }

    #[test]
    fn a_form_that_was_refused_is_not_asked_for_again() {
        let known = KnownForms::of(Version::CURRENT);
        let spheres = Written::SPHERES.since_minor();
        known.note_refused(Written::by(&Precision::Exact));
        assert!(known.knows(spheres), "every daemon knows f32: another thing was wrong");
        known.note_refused(Written::SPHERES);
        assert!(!known.knows(spheres));
        assert_eq!(known.agree(Precision::F16), Precision::F16);
        known.note_refused(Written::by(&Precision::F16));
        assert_eq!(known.agree(Precision::F16), Precision::Exact);
        assert!(known.knows(0) && !known.knows(spheres));
    }
}
