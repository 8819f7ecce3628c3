//! The auditor's exact decision, for all pairs of a scene.

use pairmask_core::sphere::Sphere;

pub use pairmaskd::audit::sphere_oracle::overlap;

pub fn pairs(spheres: &[Sphere]) -> Vec<[u32; 2]> {
    let n = spheres.len() as u32;
    let all = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b]));
    all.filter(|&[a, b]| overlap(&spheres[a as usize], &spheres[b as usize])).collect()
}
