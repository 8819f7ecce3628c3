//! mint: corners out, transforms in.

use mint::{ColumnMatrix3x4, ColumnMatrix4, Point3, RowMatrix3x4, RowMatrix4, Vector3};

matrices! {
    ColumnMatrix3x4<f32>: |matrix| <[[f32; 3]; 4]>::from(matrix);
    RowMatrix3x4<f32>: |matrix| ColumnMatrix3x4::from(matrix);
    /// The affine part: the bottom row is taken for 0 0 0 1.
    ColumnMatrix4<f32>: |matrix| <[[f32; 4]; 4]>::from(matrix);
    /// The affine part: the bottom row is taken for 0 0 0 1.
    RowMatrix4<f32>: |matrix| ColumnMatrix4::from(matrix);
}
vectors!(Point3<f32>, Vector3<f32>);

#[cfg(test)]
mod tests {
    use mint::Quaternion;

    use super::*;
    use crate::Aabb;
    use crate::update::{Placement, world_box};

    #[test]
    fn transforms_are_those_of_their_columns() {
        let local = Aabb::new([-1.0, -2.0, -0.5], [1.0, 0.5, 3.0]);
        let columns = [[1.0, 2.0, 3.0], [0.5, -4.0, 7.0], [-0.25, 8.0, 9.0], [10.0, 20.0, 30.0]];
        let world = world_box(&local, &columns);
        let narrow = ColumnMatrix3x4::from(columns);
        let wide = ColumnMatrix4::from(columns.map(|[x, y, z]| [x, y, z, 9.0]));
        assert_eq!(world_box(&local, &narrow), world);
        assert_eq!(world_box(&local, &RowMatrix3x4::from(narrow)), world);
        assert_eq!(world_box(&local, &wide), world);
        assert_eq!(world_box(&local, &RowMatrix4::from(wide)), world);
    }

    #[test]
    fn the_real_part_of_a_quaternion_comes_last() {
        let rotation = Quaternion { v: Vector3::from([1.0, 2.0, 3.0]), s: 4.0 };
        let placement = Placement::rigid(Point3::from([5.0, 6.0, 7.0]), rotation);
        assert_eq!(placement.rotation, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(placement.translation, [5.0, 6.0, 7.0]);
    }
}
