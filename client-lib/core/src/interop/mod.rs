//! Conversions of types of mathematics crates.
//!
//! Corners and centres need no conversion: constructors take `impl Into<[f32; 3]>`, which the
//! vectors of such crates implement in any version. This module converts pairs of vectors and
//! matrices, each crate behind a feature of its name.

/// Transforms of matrices that give their columns.
#[cfg(any(feature = "glam", feature = "mint"))]
macro_rules! matrices {
    ($($(#[$doc:meta])* $matrix:ty: |$it:ident| $columns:expr;)+) => {$(
        $(#[$doc])*
        impl crate::update::ToWorld for $matrix {
            crate::update::world_matrix_with_any_flags!();

            #[inline]
            fn world_matrix_with_default_flags(&self) -> crate::update::WorldMatrix {
                let $it = *self;
                crate::update::ToWorld::world_matrix_with_default_flags(&$columns)
            }
        }
    )+};
}

/// Corners and spheres to vectors.
#[cfg(any(feature = "glam", feature = "mint"))]
macro_rules! vectors {
    ($($vector:ty),+) => {$(
        impl From<crate::aabb::Aabb> for ($vector, $vector) {
            #[inline]
            fn from(b: crate::aabb::Aabb) -> Self {
                (b.min.into(), b.max.into())
            }
        }

        impl From<crate::sphere::Sphere> for ($vector, f32) {
            #[inline]
            fn from(sphere: crate::sphere::Sphere) -> Self {
                (sphere.center.into(), sphere.radius)
            }
        }
    )+};
}

#[cfg(feature = "glam")]
mod glam;
#[cfg(feature = "mint")]
mod mint;
