use glam::{Affine3A, Mat4, Quat, Vec3};
use proptest::prelude::*;

use super::*;

/// Fraction bits of the numbers in the exact test.
const FRACTION: u32 = 34;

/// k·2⁻ᵉ: any magnitude from 2⁻³⁴ to 2²⁴ with any 24 bits, as an f32 that is a whole number of
/// 2⁻³⁴.
fn number() -> impl Strategy<Value = f32> {
    let bits = -(1i32 << 24)..=1 << 24;
    prop_oneof![
        8 => (bits, 0..=FRACTION).prop_map(|(k, e)| k as f32 * 2.0f32.powi(-(e as i32))),
        1 => Just(0.0f32),
        1 => (-3i32..=3).prop_map(|x| x as f32),
    ]
}

fn vector() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(number()).prop_map(Vec3::from_array)
}

/// The matrix that moves points and turns nothing.
fn moved_by(translation: Vec3) -> [[f32; 3]; 4] {
    Affine3A::from_translation(translation).to_cols_array_2d()
}

fn local() -> impl Strategy<Value = Aabb> {
    (vector(), vector()).prop_map(|(a, b)| Aabb::new(a.min(b), a.max(b)))
}

/// An f32 as a whole number of 2⁻³⁴.
fn fixed(x: f32) -> i128 {
    let scaled = f64::from(x) * 2.0f64.powi(FRACTION as i32);
    assert_eq!(scaled.fract(), 0.0);
    scaled as i128
}

fn corners(b: &Aabb) -> impl Iterator<Item = [f32; 3]> {
    let (min, max) = (b.min, b.max);
    (0..8).map(move |c| std::array::from_fn(|j| if c >> j & 1 == 0 { min[j] } else { max[j] }))
}

/// Whether a world box reaches an exact coordinate, a whole number of 2⁻⁶⁸.
fn contains(world: &Aabb, axis: usize, exact: i128) -> bool {
    let units = |x: f32| f64::from(x) * 2.0f64.powi(2 * FRACTION as i32);
    let (low, high) = (units(world.min[axis]), units(world.max[axis]));
    low.ceil() as i128 <= exact && exact <= high.floor() as i128
}

proptest! {
    #[test]
    fn the_world_box_contains_the_exact_corners(
        local in local(),
        x in vector(),
        y in vector(),
        z in vector(),
        translation in vector(),
    ) {
        let affine = Affine3A { matrix3: glam::Mat3A::from_cols(x.into(), y.into(), z.into()), translation: translation.into() };
        let world = world_box(&local, &affine.to_cols_array_2d());
        for corner in corners(&local) {
            for axis in 0..3 {
                let terms = [x, y, z].into_iter().zip(corner).map(|(m, c)| fixed(m[axis]) * fixed(c));
                let exact = terms.sum::<i128>() + (fixed(translation[axis]) << FRACTION);
                prop_assert!(contains(&world, axis, exact), "{corner:?}, axis {axis}: {world:?}");
            }
        }
        let matrix = Mat4::from(affine).to_cols_array_2d();
        prop_assert_eq!(world_box(&local, &matrix), world);
    }

    #[test]
    fn a_placement_contains_its_corners(
        local in local(),
        translation in vector(),
        scale in vector(),
        q in prop::array::uniform4(-1.0f64..1.0),
    ) {
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        prop_assume!(length > 1e-3);
        let rotation = Quat::from_array(q.map(|x| (x / length) as f32));
        let placement =
            Placement { scale: scale.into(), ..Placement::rigid(translation, rotation) };
        let world = world_box(&local, &placement);
        for corner in corners(&local) {
            let (exact, size) = turned(&placement, corner);
            for axis in 0..3 {
                // The reference is f64 too: allow for its own rounding, and no more.
                let allowed = 1e-14 * size;
                prop_assert!(f64::from(world.min[axis]) <= exact[axis] + allowed);
                prop_assert!(f64::from(world.max[axis]) >= exact[axis] - allowed);
            }
        }
    }

    #[test]
    fn the_world_box_is_tight(local in local(), translation in vector()) {
        let world = world_box(&local, &moved_by(translation));
        for axis in 0..3 {
            let (min, max) = (f64::from(local.min[axis]), f64::from(local.max[axis]));
            let t = f64::from(translation[axis]);
            // Two units in the last place, or the error of f64 where the two cancel.
            let allowed = 1e-14 * (min.abs().max(max.abs()) + t.abs());
            let (low, high) = (world.min[axis].next_up().next_up(), world.max[axis].next_down().next_down());
            prop_assert!(f64::from(low) >= min + t - allowed, "{world:?}");
            prop_assert!(f64::from(high) <= max + t + allowed, "{world:?}");
        }
    }
}

/// `rotation · (scale · p) + translation` by cross products, not by a matrix, in f64; and the
/// largest magnitude of the intermediate numbers.
fn turned(placement: &Placement, p: [f32; 3]) -> ([f64; 3], f64) {
    let wide = |v: [f32; 3]| glam::DVec3::from_array(v.map(f64::from));
    let (v, translation) = (wide(p) * wide(placement.scale), wide(placement.translation));
    let [x, y, z, w] = placement.rotation.map(f64::from);
    let q = glam::DVec3::new(x, y, z);
    let turn = q.cross(v);
    let out = v + 2.0 * w * turn + 2.0 * q.cross(turn) + translation;
    (out.to_array(), 8.0 * v.length() + translation.length())
}

#[test]
fn far_from_the_origin_and_at_large_scales_no_corner_is_lost() {
    let local = Aabb::new(Vec3::splat(-0.1), Vec3::splat(0.3));
    for far in [1e3f32, 1.6e7, 3e9, 1e20, 3e38] {
        for scale in [1e-3f32, 1.0, 7e4, 1e18] {
            let affine = Affine3A::from_scale_rotation_translation(
                Vec3::splat(scale),
                Quat::from_rotation_y(0.3),
                Vec3::new(far, -far, far / 3.0),
            );
            let world = world_box(&local, &affine.to_cols_array_2d());
            assert_eq!(world.class(), BoxClass::Valid);
            for corner in corners(&local) {
                for axis in 0..3 {
                    let columns =
                        [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
                    let terms = columns.iter().zip(corner);
                    let sum: f64 = terms.map(|(m, c)| f64::from(m[axis]) * f64::from(c)).sum();
                    let exact = sum + f64::from(affine.translation[axis]);
                    assert!(f64::from(world.min[axis]) <= exact, "{far} {scale} {world:?}");
                    assert!(f64::from(world.max[axis]) >= exact, "{far} {scale} {world:?}");
                }
            }
        }
    }
}

#[test]
fn empty_stays_empty_and_what_is_not_a_number_is_invalid() {
    let turned = Affine3A::from_rotation_x(1.0).to_cols_array_2d();
    assert_eq!(world_box(&Aabb::EMPTY, &turned), Aabb::EMPTY);
    let mut empty = Aabb::new(Vec3::ZERO, Vec3::ONE);
    empty.max[1] = -1.0;
    assert_eq!(world_box(&empty, &turned).class(), BoxClass::Empty);
    let mut invalid = empty;
    invalid.min[2] = f32::NAN;
    assert_eq!(world_box(&invalid, &turned).class(), BoxClass::Invalid);
    let unit = Aabb::new(Vec3::ZERO, Vec3::ONE);
    for broken in [f32::NAN, f32::INFINITY] {
        let moved = moved_by(Vec3::new(0.0, broken, 0.0));
        assert_eq!(world_box(&unit, &moved).class(), BoxClass::Invalid);
        let scaled = Placement { scale: [broken; 3], ..Placement::IDENTITY };
        assert_eq!(world_box(&unit, &scaled).class(), BoxClass::Invalid);
    }
}

#[test]
fn an_infinite_box_is_infinite_only_where_it_reaches() {
    let ground = Aabb {
        min: [f32::NEG_INFINITY, f32::NEG_INFINITY, -1.0],
        max: [f32::INFINITY, f32::INFINITY, 0.0],
    };
    let lifted = world_box(&ground, &moved_by(Vec3::new(0.0, 0.0, 4.0)));
    assert_eq!((lifted.min[0], lifted.max[1]), (f32::NEG_INFINITY, f32::INFINITY));
    assert!((2.999..=3.0).contains(&lifted.min[2]) && (4.0..4.001).contains(&lifted.max[2]));
    let half = Aabb { min: [0.0; 3], max: [f32::INFINITY, 1.0, 1.0] };
    let half = world_box(&half, &Placement::IDENTITY);
    assert_eq!(half.max[0], f32::INFINITY);
    let tilted = world_box(&ground, &Affine3A::from_rotation_x(0.5).to_cols_array_2d());
    assert_eq!((tilted.min, tilted.max), ([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]));
}

#[test]
fn faces_round_outward_to_the_neighbour() {
    let (tiny, huge) = (f64::from(f32::from_bits(1)), f64::from(f32::MAX));
    for (x, expected) in [
        (1.0, 1.0),
        (1.0 + 1e-12, 1.0),
        (1.0 - 1e-12, 1.0f32.next_down()),
        (-1.0 - 1e-12, (-1.0f32).next_down()),
        (1e-60, 0.0),
        (-1e-60, -f32::from_bits(1)),
        (-tiny, -f32::from_bits(1)),
        (1.5 * tiny, f32::from_bits(1)),
        (huge * 2.0, f32::MAX),
        (-huge * 2.0, f32::NEG_INFINITY),
        (f64::INFINITY, f32::INFINITY),
        (f64::NEG_INFINITY, f32::NEG_INFINITY),
        (f64::NAN, f32::NEG_INFINITY),
    ] {
        assert_eq!(round_down(x), expected, "{x}");
        assert_eq!(round_up(-x), -expected, "{x}");
    }
}
