//! Pairmask finds the pairs that avian's own broad phase finds, in every step of the same world.
//!
//! Both look at one world, so that no difference in the solver's order drives two worlds apart: pairmask says what it
//! would add before avian's broad phase runs, and what avian has added is compared with that.

// Bevy passes each resource as an argument, by value.
#![allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]

use std::collections::BTreeSet;
use std::time::Duration;

use avian3d::collider_tree::{ColliderTreeSystems, ColliderTrees, MovedProxies};
use avian3d::collision::broad_phase::BroadPhaseSystems;
use avian3d::dynamics::solver::joint_graph::JointGraph;
use avian3d::prelude::*;
use bevy::ecs::system::SystemParam;
use bevy::prelude::*;
use bevy::time::TimeUpdateStrategy;
use pairmask::Backend;
use pairmask_avian::{PairmaskBroadPhasePlugin, PairmaskWorld, new_pairs};

type Pairs = BTreeSet<(Entity, Entity)>;

/// What both found, step by step.
#[derive(Resource, Default)]
struct Compared {
    before: Pairs,
    expected: Pairs,
    new_pairs: usize,
    steps: usize,
}

/// A custom filter: two bodies with this do not collide.
#[derive(Component)]
struct Ghost;

#[derive(SystemParam)]
struct Ghosts<'w, 's> {
    ghosts: Query<'w, 's, (), With<Ghost>>,
}

impl CollisionHooks for Ghosts<'_, '_> {
    fn filter_pairs(&self, a: Entity, b: Entity, _: &mut Commands) -> bool {
        !(self.ghosts.contains(a) && self.ghosts.contains(b))
    }
}

fn pairs_of(graph: &ContactGraph) -> Pairs {
    let pairs = graph.iter_active().chain(graph.iter_sleeping());
    pairs.map(|pair| ordered(pair.collider1, pair.collider2)).collect()
}

fn ordered(a: Entity, b: Entity) -> (Entity, Entity) {
    (a.min(b), a.max(b))
}

fn expect(
    world: ResMut<PairmaskWorld>,
    trees: Res<ColliderTrees>,
    moved: Res<MovedProxies>,
    graph: Res<ContactGraph>,
    joints: Res<JointGraph>,
    ghosts: Ghosts,
    mut commands: Commands,
    mut compared: ResMut<Compared>,
) {
    let mut hook = |a, b| ghosts.filter_pairs(a, b, &mut commands);
    let found = new_pairs(world.into_inner(), &trees, &moved, &graph, &joints, &mut hook);
    let entity = |key| trees.get_proxy(key).expect("a proxy of a pair").collider;
    let found = found.expect("an answer in this process");
    compared.before = pairs_of(&graph);
    compared.expected = found.iter().map(|(a, b)| ordered(entity(*a), entity(*b))).collect();
}

fn compare(graph: Res<ContactGraph>, mut compared: ResMut<Compared>) {
    let after = pairs_of(&graph);
    let added: Pairs = after.difference(&compared.before).copied().collect();
    let step = compared.steps;
    assert_eq!(added, compared.expected, "left avian's new pairs, right pairmask's, step {step}");
    compared.new_pairs += added.len();
    compared.steps += 1;
}

fn base(plugins: impl bevy::app::PluginGroup) -> App {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin));
    app.add_plugins(plugins);
    app.insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 64.0)));
    app
}

/// A world in which avian's own broad phase runs and is compared.
fn comparing() -> App {
    let mut app = base(PhysicsPlugins::default().with_collision_hooks::<Ghosts>());
    app.insert_resource(PairmaskWorld::new(Backend::InProcess).expect("no daemon is needed"));
    app.init_resource::<Compared>();
    app.add_systems(
        PhysicsSchedule,
        (
            expect
                .after(ColliderTreeSystems::UpdateAabbs)
                .before(BroadPhaseSystems::CollectCollisions)
                .in_set(PhysicsStepSystems::BroadPhase),
            compare
                .after(BroadPhaseSystems::CollectCollisions)
                .before(BroadPhaseSystems::Last)
                .in_set(PhysicsStepSystems::BroadPhase),
        ),
    );
    app.finish();
    app
}

/// Runs steps, and says how many pairs were new in them.
fn run(app: &mut App, steps: usize) -> usize {
    let before = app.world().resource::<Compared>().new_pairs;
    for _ in 0..steps {
        app.update();
    }
    let compared = app.world().resource::<Compared>();
    assert!(compared.steps > 0, "no step was compared");
    compared.new_pairs - before
}

fn floor(app: &mut App) -> Entity {
    let box_at = Transform::from_xyz(0.0, -0.5, 0.0);
    app.world_mut().spawn((RigidBody::Static, Collider::cuboid(100.0, 1.0, 100.0), box_at)).id()
}

fn cube(app: &mut App, x: f32, y: f32, z: f32) -> Entity {
    let box_at = Transform::from_xyz(x, y, z);
    app.world_mut().spawn((RigidBody::Dynamic, Collider::cuboid(1.0, 1.0, 1.0), box_at)).id()
}

fn stacks(app: &mut App) -> Vec<Entity> {
    let mut cubes = Vec::new();
    for x in 0..4 {
        for z in 0..4 {
            for y in 0..4 {
                cubes.push(cube(app, x as f32 * 1.04, 0.6 + y as f32 * 1.1, z as f32 * 1.04));
            }
        }
    }
    cubes
}

#[test]
fn stacks_fall_and_sleep() {
    let mut app = comparing();
    floor(&mut app);
    stacks(&mut app);
    assert!(run(&mut app, 400) > 64);
}

#[test]
fn layers_keep_bodies_apart_and_may_change() {
    let mut app = comparing();
    let floor = floor(&mut app);
    let all = LayerMask::ALL;
    app.world_mut().entity_mut(floor).insert(CollisionLayers::new(LayerMask(1), all));
    for (i, one) in stacks(&mut app).into_iter().enumerate() {
        let bit = LayerMask(2 << (i % 3));
        app.world_mut().entity_mut(one).insert(CollisionLayers::new(bit, LayerMask(1) | bit));
    }
    assert!(run(&mut app, 60) > 0);
    app.world_mut().entity_mut(floor).insert(CollisionLayers::new(LayerMask(1), LayerMask(2)));
    run(&mut app, 100);
}

#[test]
fn sensors_meet_static_bodies_and_moving_ones() {
    let mut app = comparing();
    floor(&mut app);
    stacks(&mut app);
    let box_at = Transform::from_xyz(1.0, 0.5, 1.0);
    let sensor = (RigidBody::Static, Collider::cuboid(3.0, 3.0, 3.0), box_at, Sensor);
    let sensor = app.world_mut().spawn(sensor).id();
    app.world_mut().spawn((Collider::cuboid(2.0, 2.0, 2.0), Transform::from_xyz(0.0, 1.0, 0.0)));
    app.world_mut().spawn((
        RigidBody::Kinematic,
        LinearVelocity(Vec3::new(1.0, 0.0, 0.0)),
        Collider::sphere(1.0),
        Transform::from_xyz(-4.0, 1.0, 1.0),
        Sensor,
    ));
    assert!(run(&mut app, 120) > 64);
    app.world_mut().entity_mut(sensor).remove::<Sensor>();
    run(&mut app, 60);
}

#[test]
fn bodies_come_and_go() {
    let mut app = comparing();
    let floor = floor(&mut app);
    let mut cubes = stacks(&mut app);
    for round in 0..30_usize {
        run(&mut app, 6);
        let ended = cubes.swap_remove(round * 7 % cubes.len());
        app.world_mut().despawn(ended);
        cubes.push(cube(&mut app, (round % 4) as f32, 6.0, 1.0));
        let other = cubes[round * 5 % cubes.len()];
        let kind = if round % 2 == 0 { RigidBody::Kinematic } else { RigidBody::Dynamic };
        app.world_mut().entity_mut(other).insert(kind);
        let hidden = cubes[round * 3 % cubes.len()];
        app.world_mut().entity_mut(hidden).insert(ColliderDisabled);
        run(&mut app, 2);
        app.world_mut().entity_mut(hidden).remove::<ColliderDisabled>();
    }
    app.world_mut().despawn(floor);
    run(&mut app, 30);
}

#[test]
fn joints_and_hooks_keep_bodies_apart() {
    let mut app = comparing();
    floor(&mut app);
    let cubes = stacks(&mut app);
    for pair in cubes.chunks_exact(2).step_by(2) {
        app.world_mut().spawn((FixedJoint::new(pair[0], pair[1]), JointCollisionDisabled));
    }
    for one in cubes.iter().skip(1).step_by(2) {
        app.world_mut().entity_mut(*one).insert((Ghost, ActiveCollisionHooks::FILTER_PAIRS));
    }
    assert!(run(&mut app, 120) > 0);
}

#[test]
#[should_panic(expected = "pairmask's")]
fn a_pair_too_few_is_noticed() {
    let mut app = comparing();
    let discard = |mut compared: ResMut<Compared>| {
        compared.expected.pop_first();
    };
    app.add_systems(
        PhysicsSchedule,
        discard.after(expect).before(BroadPhaseSystems::CollectCollisions),
    );
    floor(&mut app);
    stacks(&mut app);
    run(&mut app, 20);
}

#[test]
fn cubes_come_to_rest_without_avians_own_broad_phase() {
    let plugins = PhysicsPlugins::default().build().disable::<BvhBroadPhasePlugin>();
    // No daemon serves here: the pairs are found in this process.
    let mut app = base(plugins.add(PairmaskBroadPhasePlugin::<()>::default()));
    app.finish();
    floor(&mut app);
    let cubes = stacks(&mut app);
    (0..400).for_each(|_| app.update());
    for one in cubes {
        let y = app.world().get::<Position>(one).expect("a body has a position").y;
        assert!((0.4..5.0).contains(&y), "a cube at {y}");
    }
}
