//! Every peer against the oracle, over moving boxes: a library that is used wrongly would make
//! Pairmask look too good.

use pairmask_lab::study::moving::{Motion, World};
use pairmaskd::scene::{Random, Scene, SceneName};
use rayon::ThreadPoolBuilder;

use super::contender::Contender;
use super::obvhs::Obvhs;
use super::pair_sets::PairSet;
use super::parry::{Parry, Upkeep};
use super::parry_scene::{ParryScene, ParryWay};
use super::rapier::Rapier;
use super::rstar::Rstar;
use super::tally::Tally;
use super::{obvhs, ours};
use crate::oracle;

#[test]
fn every_peer_has_the_oracles_pairs() {
    let two = ThreadPoolBuilder::new().num_threads(2).build().expect("two threads");
    for name in [SceneName::Uniform, SceneName::Mixed, SceneName::Pile, SceneName::Plane] {
        for n in [2, 70, 1_234] {
            let mut scene = Scene::new(name, n, 3);
            let boxes = scene.boxes();
            let mut contenders: Vec<(&str, Box<dyn Contender>)> =
                vec![("rapier", Box::new(Rapier::new(n))), ("ours", Box::new(in_process()))];
            for threads in [1, 2] {
                for upkeep in [Upkeep::Refit, Upkeep::OptimizeRefit, Upkeep::Rebuild] {
                    contenders.push(("parry", Box::new(Parry::new(boxes, upkeep, threads))));
                }
                for upkeep in [obvhs::Upkeep::Refit, obvhs::Upkeep::Rebuild] {
                    contenders.push(("obvhs", Box::new(Obvhs::new(boxes, upkeep, threads))));
                }
                contenders.push(("rstar", Box::new(Rstar::new(threads))));
            }
            for frame in 0..12 {
                scene.step();
                let boxes = scene.boxes();
                let pairs = oracle::truth(boxes).pairs;
                let expected = Tally::of(&pairs);
                let truth = PairSet::new(pairs).expect("the oracle lists each pair once");
                for (peer, contender) in &mut contenders {
                    let (tally, found) = two.install(|| {
                        contender.write(boxes).expect("boxes are taken");
                        let tally = contender.find(boxes).expect("pairs are found");
                        (tally, contender.pairs(boxes).expect("pairs are listed"))
                    });
                    assert_eq!(truth.check(found), Ok(()), "{peer}, {name}, {n}, frame {frame}");
                    assert_eq!(tally, expected, "{peer}, {name}, {n}, frame {frame}");
                }
            }
        }
    }
}

fn in_process() -> ours::Ours {
    let builder = pairmask::Session::builder().backend(pairmask::Backend::InProcess);
    ours::Ours::new(builder.connect().expect("a session"), 2, std::time::Duration::ZERO)
}

/// Peers in the state of a scene that persists, which are given the boxes that moved alone.
#[test]
fn peers_that_are_given_movers_alone_have_the_oracles_pairs() {
    for (seed, n) in [(1, 3), (2, 70), (3, 1_234)] {
        for motion in Motion::ALL.map(|(_, motion)| motion) {
            let mut world = World::new(SceneName::Pile, n);
            let ways = [ParryWay::Changes, ParryWay::Queries];
            let mut parries: Vec<ParryScene> = [1, 2]
                .into_iter()
                .flat_map(|threads| ways.map(|way| (way, threads)))
                .map(|(way, threads)| ParryScene::new(world.boxes(), way, threads))
                .collect();
            let mut rapier = Rapier::new(n);
            rapier.change((0..).zip(world.boxes())).expect("a list");
            let mut random = Random::new(seed);
            for frame in 0..25 {
                let most = [1 + n / 50, 1 + n / 5, n][random.below(3) as usize];
                let (moved, boxes) = world.step(random.below(most as u64 + 1) as usize, motion);
                let truth = PairSet::new(oracle::truth(world.boxes()).pairs).expect("once each");
                for (place, parry) in parries.iter_mut().enumerate() {
                    parry.change(&moved, world.boxes()).expect("a list");
                    let what = format!("parry {place}, {n} boxes, {motion:?}, frame {frame}");
                    assert_eq!(truth.check(parry.pairs()), Ok(()), "{what}");
                }
                rapier.change(moved.iter().copied().zip(&boxes)).expect("a list");
                let pairs = rapier.pairs(world.boxes()).expect("a list");
                assert_eq!(truth.check(pairs), Ok(()), "rapier, {n} boxes, {motion:?}, {frame}");
            }
        }
    }
}
