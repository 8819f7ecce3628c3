//! Pair sets that do not change: the same on every engine, machine, number of threads, and in every language.

use pairmaskd::scene::{Scene, SceneName};

pub fn scene(name: SceneName) -> Scene {
    let mut scene = Scene::new(name, 3_000, 7);
    scene.step();
    scene
}

/// The [hash](pairmask_core::oracle::pair_set_hash) of each [scene]'s pairs.
pub const GOLDEN: [(SceneName, u64); 13] = [
    (SceneName::Uniform, 0xba94_9923_e192_43bd),
    (SceneName::Mixed, 0xa2a0_6036_d30b_94be),
    (SceneName::Pile, 0xc581_fab0_f72b_84f8),
    (SceneName::Plane, 0x86b3_0652_dec3_4839),
    (SceneName::Cubes, 0x8fc7_3aad_c749_5f74),
    (SceneName::Balls, 0x6867_2626_93d9_a159),
    (SceneName::Skittles, 0xaa6a_c834_6176_3a3c),
    (SceneName::Torus, 0x054b_f2d3_e948_0ee7),
    (SceneName::Letters, 0xa897_e8a0_3645_1a6f),
    (SceneName::OneCell, 0x8f88_0ade_f04c_96c5),
    (SceneName::Rods, 0xb458_5d6b_c9e4_65df),
    (SceneName::Giants, 0x74a4_fdb9_cc42_d055),
    (SceneName::Far, 0x0e54_332c_d913_c652),
];
