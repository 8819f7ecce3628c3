//! Pair sets that do not change: the same on every engine, machine, number of threads, and in every language.

use pairmaskd::scene::{Scene, SceneName};

/// Name, boxes, seed and hash, line by line.
const SCENES: &str = include_str!("../golden-scenes.txt");

/// Each golden scene with the [hash](pairmask_core::oracle::pair_set_hash) of its pairs.
pub fn scenes() -> Vec<(SceneName, Scene, u64)> {
    let lines = SCENES.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            let [name, n, seed, hash] = words[..] else { panic!("no golden scene: {line}") };
            let name: SceneName = name.parse().expect("a scene");
            let hash = u64::from_str_radix(hash.trim_start_matches("0x"), 16).expect("a hash");
            let number = |text: &str| text.parse::<usize>().expect("a number");
            (name, Scene::new(name, number(n), number(seed) as u64), hash)
        })
        .collect()
}
