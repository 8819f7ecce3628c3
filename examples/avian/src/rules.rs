//! Which overlapping pairs avian takes: the rules of its own `bvh_broad_phase.rs`, in the same order.

use avian3d::collider_tree::{
    ColliderTreeProxy, ColliderTreeProxyKey, ColliderTrees, MovedProxies,
};
use avian3d::data_structures::pair_key::PairKey;
use avian3d::dynamics::solver::joint_graph::JointGraph;
use avian3d::prelude::*;
use bevy::prelude::*;

use crate::world::{PairmaskWorld, key_of};

/// Two proxies, in the order in which avian names them in a contact.
pub type KeyPair = (ColliderTreeProxyKey, ColliderTreeProxyKey);

/// The pairs that this step adds to a contact graph. `hook` says whether a pair with a custom filter collides.
///
/// # Errors
/// [`pairmask::Error`], if there is no answer.
pub fn new_pairs(
    world: &mut PairmaskWorld,
    trees: &ColliderTrees,
    moved: &MovedProxies,
    graph: &ContactGraph,
    joints: &JointGraph,
    hook: &mut dyn FnMut(Entity, Entity) -> bool,
) -> Result<Vec<KeyPair>, pairmask::Error> {
    let mut found = Vec::new();
    for [a, b] in world.pairs(trees, moved)? {
        let (a, b) = (key_of(*a), key_of(*b));
        let (Some(proxy_a), Some(proxy_b)) = (trees.get_proxy(a), trees.get_proxy(b)) else {
            continue;
        };
        let sides = [((a, proxy_a), (b, proxy_b)), ((b, proxy_b), (a, proxy_a))];
        let asked = sides.into_iter().find(|(one, two)| asks(*one, two.0, moved));
        let Some(((key1, proxy1), (key2, proxy2))) = asked else { continue };
        if may_collide(proxy1, proxy2, graph, joints, hook) {
            found.push((key1, key2));
        }
    }
    Ok(found)
}

/// Whether avian's query for a proxy reports the pair with another one. At most one of the two sides does, but where
/// sensors are involved: then the first one counts.
fn asks(
    (key1, proxy1): (ColliderTreeProxyKey, &ColliderTreeProxy),
    key2: ColliderTreeProxyKey,
    moved: &MovedProxies,
) -> bool {
    let order = |key: ColliderTreeProxyKey| (key.tree_type() as u8, key.id().id());
    let other_asks = order(key1) > order(key2) && moved.contains(key2);
    let both_static = key1.is_static() && key2.is_static();
    moved.contains(key1) && (proxy1.is_sensor() || !(other_asks || both_static))
}

fn may_collide(
    proxy1: &ColliderTreeProxy,
    proxy2: &ColliderTreeProxy,
    graph: &ContactGraph,
    joints: &JointGraph,
    hook: &mut dyn FnMut(Entity, Entity) -> bool,
) -> bool {
    let (one, two) = (proxy1.collider, proxy2.collider);
    if !proxy1.layers.interacts_with(proxy2.layers)
        || proxy1.body == proxy2.body
        || graph.contains_key(&PairKey::new(one.index_u32(), two.index_u32()))
    {
        return false;
    }
    if let (Some(body1), Some(body2)) = (proxy1.body, proxy2.body)
        && joints.joints_between(body1, body2).any(|edge| edge.collision_disabled)
    {
        return false;
    }
    !(proxy1.has_custom_filter() || proxy2.has_custom_filter()) || hook(one, two)
}
