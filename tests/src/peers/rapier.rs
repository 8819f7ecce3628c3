//! rapier3d's broad phase by itself: boxes set one by one, pairs that came and went as events.
//!
//! It grows each box by a margin (0.04 of its length unit) and reports the pairs of fat AABBs
//! when they begin and end, so its user keeps the list; here that list is filtered by the boxes
//! themselves, so that sets compare. Colliders have no body and all their types may collide.

use pairmask_core::Aabb;
use rapier3d::math::Vector;
use rapier3d::parry::bounding_volume::Aabb as ParryBox;
use rapier3d::prelude::{
    ActiveCollisionTypes, BroadPhaseBvh, BroadPhasePairEvent, ColliderBuilder, ColliderHandle,
    ColliderPair, ColliderSet, IntegrationParameters, RigidBodySet,
};

use super::contender::{Contender, ContenderError, Tally, remove, touches};
use crate::oracle::Pair;

pub struct Rapier {
    broad_phase: BroadPhaseBvh,
    parameters: IntegrationParameters,
    colliders: ColliderSet,
    bodies: RigidBodySet,
    handles: Vec<ColliderHandle>,
    events: Vec<BroadPhasePairEvent>,
    /// For each box the boxes of higher index that it forms a pair with.
    partners: Vec<Vec<u32>>,
}

impl Rapier {
    pub fn new(n: usize) -> Self {
        let mut colliders = ColliderSet::new();
        let collider =
            ColliderBuilder::ball(0.5).active_collision_types(ActiveCollisionTypes::all());
        let handles = (0..n).map(|_| colliders.insert(collider.clone())).collect();
        Self {
            broad_phase: BroadPhaseBvh::new(),
            parameters: IntegrationParameters::default(),
            colliders,
            bodies: RigidBodySet::new(),
            handles,
            events: Vec::new(),
            partners: vec![Vec::new(); n],
        }
    }

    /// Sets some boxes and keeps the list of pairs of fat AABBs. Returns how many of them began or ended.
    pub fn change<'a>(
        &mut self,
        boxes: impl IntoIterator<Item = (u32, &'a Aabb)>,
    ) -> Result<usize, ContenderError> {
        for (index, b) in boxes {
            let b = ParryBox::new(Vector::from_array(b.min), Vector::from_array(b.max));
            self.broad_phase.set_aabb(&self.parameters, self.handles[index as usize], b);
        }
        self.events.clear();
        let (parameters, colliders, bodies) = (&self.parameters, &self.colliders, &self.bodies);
        self.broad_phase.update(parameters, colliders, bodies, &[], &[], &mut self.events);
        for event in &self.events {
            match event {
                BroadPhasePairEvent::AddPair(pair) => {
                    let [a, b] = indices(pair);
                    self.partners[a as usize].push(b);
                }
                BroadPhasePairEvent::DeletePair(pair) => {
                    let [a, b] = indices(pair);
                    remove("rapier", &mut self.partners[a as usize], [b, a])?;
                }
            }
        }
        Ok(self.events.len())
    }

    fn iterate(&self, boxes: &[Aabb], mut iterate: impl FnMut(u32, u32)) {
        for (a, partners) in (0u32..).zip(&self.partners) {
            for &b in partners {
                if touches(&boxes[a as usize], &boxes[b as usize]) {
                    iterate(a, b);
                }
            }
        }
    }
}

/// Colliders were inserted in object order and none was removed, so a handle's place is its box.
fn indices(pair: &ColliderPair) -> Pair {
    let (a, b) = (pair.collider1.into_raw_parts().0, pair.collider2.into_raw_parts().0);
    [a.min(b), a.max(b)]
}

impl Contender for Rapier {
    fn find(&mut self, boxes: &[Aabb]) -> Result<Tally, ContenderError> {
        self.change((0..).zip(boxes))?;
        let mut tally = Tally::default();
        self.iterate(boxes, |a, b| tally.iterate(a, b));
        Ok(tally)
    }

    fn pairs(&mut self, boxes: &[Aabb]) -> Result<Vec<Pair>, ContenderError> {
        let mut pairs = Vec::new();
        self.iterate(boxes, |a, b| pairs.push([a, b]));
        Ok(pairs)
    }
}
