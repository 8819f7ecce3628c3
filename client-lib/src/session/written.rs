//! How the objects of a frame are written.

use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::{Precision, Widening};
use pairmask_core::units::BoxCount;
use pairmask_wire::SceneSections;

/// The form in which the objects of a frame are written, and the extra pairs that it may add.
#[derive(Clone, Copy, Debug)]
pub(super) struct Written {
    pub form: ObjectForm,
    pub widening: Widening,
    /// So many boxes are set A, and the others set B; `None` where all pairs count.
    pub first_set: Option<BoxCount>,
}

impl Written {
    /// Spheres, exact.
    pub(super) const SPHERES: Self =
        Self { form: ObjectForm::Spheres, widening: Widening::None, first_set: None };

    /// Boxes written with a precision.
    pub(super) fn by(precision: &Precision) -> Self {
        let (form, widening) = (precision.form().into(), precision.widening());
        Self { form, widening, first_set: None }
    }

    /// Where all of it lies in the memory of a frame of `n` objects.
    pub(super) fn scene(self, n: BoxCount) -> SceneSections {
        SceneSections::first(self.form, n)
    }
}
