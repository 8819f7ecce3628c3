//! glam: corners out, transforms in.

use glam::{Affine3A, Mat4, Vec3, Vec3A};

matrices! {
    Affine3A: |matrix| matrix.to_cols_array_2d();
    /// The affine part: the bottom row is taken for 0 0 0 1.
    Mat4: |matrix| matrix.to_cols_array_2d();
}
vectors!(Vec3, Vec3A);

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::update::{Placement, world_box};
    use crate::{Aabb, Sphere};

    #[test]
    fn vectors_go_in_and_come_out() {
        let (min, max) = (Vec3::new(1.0, 2.0, 3.0), Vec3::splat(4.0));
        let b = Aabb { min: [1.0, 2.0, 3.0], max: [4.0; 3] };
        assert_eq!([Aabb::new(min, max), (Vec3A::from(min), max).into()], [b; 2]);
        assert_eq!(<(Vec3, Vec3)>::from(b), (min, max));
        assert_eq!(<(Vec3A, Vec3A)>::from(b), (min.into(), max.into()));
        let sphere = Sphere { center: b.min, radius: 0.5 };
        assert_eq!([Sphere::new(min, 0.5), (min, 0.5).into()], [sphere; 2]);
        assert_eq!(<(Vec3, f32)>::from(sphere), (min, 0.5));
    }

    #[test]
    fn transforms_are_those_of_their_columns() {
        let local = Aabb::new([-1.0, -2.0, -0.5], [1.0, 0.5, 3.0]);
        let (rotation, translation) = (Quat::from_rotation_y(0.3), Vec3::new(1.0, -20.0, 300.0));
        let affine = Affine3A::from_scale_rotation_translation(
            Vec3::new(1.0, 2.0, 0.25),
            rotation,
            translation,
        );
        let world = world_box(&local, &affine);
        assert_eq!(world_box(&local, &affine.to_cols_array_2d()), world);
        assert_eq!(world_box(&local, &Mat4::from(affine)), world);
        let placement = Placement::rigid(translation, rotation);
        assert_eq!(placement.rotation, rotation.to_array());
        assert_eq!(placement.translation, translation.to_array());
    }
}
