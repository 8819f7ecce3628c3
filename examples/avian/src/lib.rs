//! Pairmask as the broad phase of avian, the physics engine of Bevy.
//!
//! [`PairmaskBroadPhasePlugin`] stands in place of avian's `BvhBroadPhasePlugin`:
//!
//! ```no_run
//! use avian3d::prelude::*;
//! use bevy::prelude::*;
//! use pairmask_avian::PairmaskBroadPhasePlugin;
//!
//! App::new().add_plugins(
//!     PhysicsPlugins::default()
//!         .build()
//!         .disable::<BvhBroadPhasePlugin>()
//!         .add(PairmaskBroadPhasePlugin::<()>::default()),
//! );
//! ```
//!
//! Boxes are those of avian's collider trees, which avian keeps anyway for its spatial queries: a box is sent when
//! avian says that its proxy has moved. Pairs that end are taken out by avian's narrow phase, as with its own broad
//! phase.

mod rules;
mod world;

use core::marker::PhantomData;
use std::time::Instant;

use avian3d::collider_tree::{ColliderTreeProxyFlags, ColliderTrees, MovedProxies};
use avian3d::collision::CollisionDiagnostics;
use avian3d::collision::broad_phase::BroadPhaseSystems;
use avian3d::collision::contact_types::ContactEdgeFlags;
use avian3d::dynamics::solver::joint_graph::JointGraph;
use avian3d::prelude::*;
use bevy::ecs::system::{StaticSystemParam, SystemParamItem};
use bevy::prelude::*;
use pairmask::Backend;

pub use rules::{KeyPair, new_pairs};
pub use world::PairmaskWorld;

/// Finds avian's pairs with pairmask. `H` are the [`CollisionHooks`] that avian's own plugin would be given.
pub struct PairmaskBroadPhasePlugin<H: CollisionHooks = ()> {
    backend: Backend,
    hooks: PhantomData<H>,
}

impl<H: CollisionHooks> PairmaskBroadPhasePlugin<H> {
    /// With a backend of the user's choice. A backend that cannot be had is replaced by this process, with a warning.
    pub const fn with_backend(backend: Backend) -> Self {
        Self { backend, hooks: PhantomData }
    }
}

impl<H: CollisionHooks> Default for PairmaskBroadPhasePlugin<H> {
    /// With the daemon where one serves, else in this process.
    fn default() -> Self {
        Self::with_backend(Backend::Auto)
    }
}

impl<H: CollisionHooks + 'static> Plugin for PairmaskBroadPhasePlugin<H>
where
    for<'w, 's> SystemParamItem<'w, 's, H>: CollisionHooks,
{
    fn build(&self, app: &mut App) {
        match PairmaskWorld::new(self.backend) {
            Ok(world) => {
                app.insert_resource(world);
                app.add_systems(
                    PhysicsSchedule,
                    collect_pairs::<H>.in_set(BroadPhaseSystems::CollectCollisions),
                );
            }
            Err(error) => log::error!("no broad phase: {error}"),
        }
    }
}

// Bevy passes each resource as an argument, by value.
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
fn collect_pairs<H: CollisionHooks>(
    world: ResMut<PairmaskWorld>,
    trees: Res<ColliderTrees>,
    moved: Res<MovedProxies>,
    hooks: StaticSystemParam<H>,
    mut commands: Commands,
    mut graph: ResMut<ContactGraph>,
    joints: Res<JointGraph>,
    mut diagnostics: ResMut<CollisionDiagnostics>,
) where
    for<'w, 's> SystemParamItem<'w, 's, H>: CollisionHooks,
{
    let start = Instant::now();
    let hooks = hooks.into_inner();
    let mut hook = |a, b| hooks.filter_pairs(a, b, &mut commands);
    match new_pairs(world.into_inner(), &trees, &moved, &graph, &joints, &mut hook) {
        Ok(pairs) => pairs.iter().for_each(|pair| add_pair(&mut graph, &trees, *pair)),
        Err(error) => log::error!("a step without new pairs: {error}"),
    }
    diagnostics.broad_phase += start.elapsed();
}

/// Puts a pair into the contact graph, with the flags that avian's own broad phase gives it.
fn add_pair(graph: &mut ContactGraph, trees: &ColliderTrees, (key1, key2): KeyPair) {
    let (Some(proxy1), Some(proxy2)) = (trees.get_proxy(key1), trees.get_proxy(key2)) else {
        return;
    };
    let flags = proxy1.flags.union(proxy2.flags);
    let mut edge = ContactEdge::new(proxy1.collider, proxy2.collider);
    edge.body1 = proxy1.body;
    edge.body2 = proxy2.body;
    edge.flags.set(
        ContactEdgeFlags::CONTACT_EVENTS,
        flags.contains(ColliderTreeProxyFlags::CONTACT_EVENTS),
    );
    graph.add_edge_with(edge, |contact| {
        contact.body1 = proxy1.body;
        contact.body2 = proxy2.body;
        contact.flags.set(
            ContactPairFlags::MODIFY_CONTACTS,
            flags.contains(ColliderTreeProxyFlags::MODIFY_CONTACTS),
        );
        let inert = ColliderTreeProxyFlags::BODY_DISABLED.union(ColliderTreeProxyFlags::SENSOR);
        contact.flags.set(ContactPairFlags::GENERATE_CONSTRAINTS, !flags.intersects(inert));
    });
}
