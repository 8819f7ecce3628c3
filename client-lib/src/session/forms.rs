//! The forms of objects that a daemon can be sent: an older daemon knows fewer.

use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};

use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::{BoxForm, Precision};
use pairmask_wire::{Version, since_minor};

/// The forms of objects that the daemon of a connection knows.
#[derive(Debug)]
pub(super) struct KnownForms {
    /// The minor wire version up to which the daemon knows forms.
    minor: AtomicU16,
    /// Whether the log says that frames are exact.
    told_exact: AtomicBool,
    /// Whether the log says that frames of spheres are answered in process.
    told_spheres: AtomicBool,
}

impl KnownForms {
    /// The forms of a daemon, by the version that it states.
    pub(super) const fn of(version: Version) -> Self {
        Self {
            minor: AtomicU16::new(version.minor),
            told_exact: AtomicBool::new(false),
            told_spheres: AtomicBool::new(false),
        }
    }

    /// Whether the daemon knows spheres.
    pub(super) fn knows_spheres(&self) -> bool {
        self.knows(ObjectForm::Spheres)
    }

    /// Logs once that frames of spheres are answered in process.
    pub(super) fn say_spheres_stay(&self) {
        if !self.told_spheres.swap(true, Ordering::Relaxed) {
            log::warn!("the daemon does not know spheres: their frames are answered in process");
        }
    }

    /// The precision that the daemon can be sent: an older daemon gets exact boxes, which is logged
    /// once.
    pub(super) fn agree(&self, asked: Precision) -> Precision {
        if self.knows(asked.form().into()) {
            return asked;
        }
        self.say_exact(asked.form());
        Precision::Exact
    }

    /// Notes that the daemon refused a form, whatever version it stated: that form and those of
    /// later versions are not sent again.
    pub(super) fn note_refused(&self, form: ObjectForm) {
        let Some(before) = since_minor(form).checked_sub(1) else { return };
        self.minor.fetch_min(before, Ordering::Relaxed);
        if let ObjectForm::Boxes(form) = form {
            self.say_exact(form);
        }
    }

    fn knows(&self, form: ObjectForm) -> bool {
        since_minor(form) <= self.minor.load(Ordering::Relaxed)
    }

    fn say_exact(&self, form: BoxForm) {
        if !self.told_exact.swap(true, Ordering::Relaxed) {
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
            assert!(new.knows(form), "{form}");
            assert_eq!(narrow.knows(form), form != ObjectForm::Spheres, "{form}");
            assert_eq!(old.knows(form), form == BoxForm::F32.into(), "{form}");
        }
    }

    #[test]
    fn a_form_that_was_refused_is_not_asked_for_again() {
        let known = KnownForms::of(Version::CURRENT);
        known.note_refused(BoxForm::F32.into());
        assert!(known.knows_spheres(), "every daemon knows f32: another thing was wrong");
        known.note_refused(ObjectForm::Spheres);
        assert!(!known.knows_spheres());
        assert_eq!(known.agree(Precision::F16), Precision::F16);
        known.note_refused(BoxForm::F16.into());
        assert_eq!(known.agree(Precision::F16), Precision::Exact);
        assert!(known.knows(BoxForm::F32.into()) && !known.knows_spheres());
    }
}
