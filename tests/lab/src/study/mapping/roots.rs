//! Square roots in f32: built in, and by a first guess and Newton steps.

use crate::study::mapping::stage::{Magic, Root, Steps};

/// √x as x · 1/√x: a first guess from the bits of x, then `STEPS` steps of Newton.
///
/// Source: Avril et al. 2012, §3.3, after Quake III (`Q_rsqrt`).
#[inline(always)]
pub fn newton<const MAGIC: u32, const STEPS: u32>(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(MAGIC.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..STEPS {
        y *= 1.5 - half * y * y;
    }
    x * y
}

/// Work on a root, compiled separately for each root with the root inlined, so that times are those
/// of the root.
pub trait RootVisitor {
    /// The result.
    type Out;

    /// Does the work.
    fn visit(self, root: impl Fn(f32) -> f32 + Copy + Sync) -> Self::Out;
}

/// Calls the visitor with the root of that name.
pub fn with_root<V: RootVisitor>(root: Root, visitor: V) -> V::Out {
    const CARMACK: u32 = Magic::Carmack as u32;
    const LOMONT: u32 = Magic::Lomont as u32;
    match root {
        Root::BuiltIn => visitor.visit(f32::sqrt),
        Root::Newton(Magic::Carmack, Steps::One) => visitor.visit(newton::<CARMACK, 1>),
        Root::Newton(Magic::Carmack, Steps::Two) => visitor.visit(newton::<CARMACK, 2>),
        Root::Newton(Magic::Carmack, Steps::Three) => visitor.visit(newton::<CARMACK, 3>),
        Root::Newton(Magic::Carmack, Steps::Four) => visitor.visit(newton::<CARMACK, 4>),
        Root::Newton(Magic::Lomont, Steps::One) => visitor.visit(newton::<LOMONT, 1>),
        Root::Newton(Magic::Lomont, Steps::Two) => visitor.visit(newton::<LOMONT, 2>),
        Root::Newton(Magic::Lomont, Steps::Three) => visitor.visit(newton::<LOMONT, 3>),
        Root::Newton(Magic::Lomont, Steps::Four) => visitor.visit(newton::<LOMONT, 4>),
    }
}
