//! avian's proxies in a scene of pairmask: what moved goes in, pairs of what moved come out.

use avian3d::collider_tree::{
    ColliderTreeProxy, ColliderTreeProxyKey, ColliderTreeType, ColliderTrees, MovedProxies, ProxyId,
};
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use pairmask::{Aabb, Backend, Error, Report, Scene, SceneOptions, Session};

/// What the scene knows of an index.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Known {
    collider: Entity,
    /// Static, and no sensor: avian leaves out pairs of two such boxes.
    is_static: bool,
}

/// The scene, and what was sent to it. An index is a proxy's key: its number, times four, plus its tree.
#[derive(Resource)]
pub struct PairmaskWorld {
    /// A scene is one thread's at a time.
    scene: SyncCell<Scene>,
    known: Vec<Option<Known>>,
    known_count: usize,
    changes: Changes,
    pairs: Vec<[u32; 2]>,
}

/// What one step changes, kept so that steady steps allocate nothing.
#[derive(Default)]
struct Changes {
    set: Vec<u32>,
    boxes: Vec<Aabb>,
    removed: Vec<u32>,
    to_static: Vec<u32>,
    to_moving: Vec<u32>,
}

impl Changes {
    fn clear(&mut self) {
        for list in [&mut self.set, &mut self.removed, &mut self.to_static, &mut self.to_moving] {
            list.clear();
        }
        self.boxes.clear();
    }
}

/// The index of a proxy.
fn index_of(key: ColliderTreeProxyKey) -> u32 {
    key.id().id() << 2 | key.tree_type() as u32
}

/// The proxy of an index.
pub(crate) const fn key_of(index: u32) -> ColliderTreeProxyKey {
    let tree_type = match index & 3 {
        0 => ColliderTreeType::Dynamic,
        1 => ColliderTreeType::Kinematic,
        2 => ColliderTreeType::Static,
        _ => ColliderTreeType::Standalone,
    };
    ColliderTreeProxyKey::new(ProxyId::new(index >> 2), tree_type)
}

fn box_of(trees: &ColliderTrees, key: ColliderTreeProxyKey) -> Option<Aabb> {
    let found = trees.tree_for_type(key.tree_type()).get_proxy_aabb(key.id())?;
    Some(Aabb::new(found.min.to_array(), found.max.to_array()))
}

fn scene_of(backend: Backend) -> Result<Scene, Error> {
    let mut session = Session::builder().backend(backend).connect()?;
    session.scene(SceneOptions::default())
}

impl PairmaskWorld {
    /// An empty scene. A backend that cannot be had is replaced by this process.
    ///
    /// # Errors
    /// [`Error`], if this process has no session either.
    pub fn new(backend: Backend) -> Result<Self, Error> {
        let scene = scene_of(backend).or_else(|error| {
            log::warn!("the broad phase answers in this process: {error}");
            scene_of(Backend::InProcess)
        })?;
        Ok(Self {
            scene: SyncCell::new(scene),
            known: Vec::new(),
            known_count: 0,
            changes: Changes::default(),
            pairs: Vec::new(),
        })
    }

    /// Overlapping pairs of proxies with at least one that moved, by index, sorted.
    ///
    /// # Errors
    /// [`Error`], if this process has no answer either.
    pub(crate) fn pairs(
        &mut self,
        trees: &ColliderTrees,
        moved: &MovedProxies,
    ) -> Result<&[[u32; 2]], Error> {
        self.collect(trees, moved);
        if let Err(error) = self.ask() {
            log::warn!("the broad phase answers in this process from now on: {error}");
            self.start_anew()?;
            self.collect(trees, moved);
            if let Err(error) = self.ask() {
                // What was sent is not known: the next step sends all to a scene of its own.
                self.start_anew()?;
                return Err(error);
            }
        }
        Ok(&self.pairs)
    }

    /// Takes a scene of this process, to which nothing was sent.
    fn start_anew(&mut self) -> Result<(), Error> {
        self.known.clear();
        self.known_count = 0;
        self.scene = SyncCell::new(scene_of(Backend::InProcess)?);
        Ok(())
    }

    /// Compares what is known with avian's trees. avian has no list of removed proxies, and names each new one as
    /// moved: so all are looked at where their number is another one than the known ones'.
    fn collect(&mut self, trees: &ColliderTrees, moved: &MovedProxies) {
        self.changes.clear();
        for key in moved.proxies() {
            if let Some(proxy) = trees.get_proxy(*key) {
                self.note(trees, *key, proxy, true);
            }
        }
        // A sensor is one by a flag, with which no box moves.
        let tree_type = ColliderTreeType::Static;
        for (id, proxy) in trees.tree_for_type(tree_type).proxies.iter() {
            let key = ColliderTreeProxyKey::new(ProxyId::new(id as u32), tree_type);
            self.note(trees, key, proxy, false);
        }
        let proxies: usize =
            ColliderTreeType::ALL.map(|tree| trees.tree_for_type(tree).proxies.len()).iter().sum();
        if self.known_count != proxies {
            self.sweep(trees);
        }
    }

    /// Looks at every proxy.
    fn sweep(&mut self, trees: &ColliderTrees) {
        for (index, slot) in (0..).zip(&mut self.known) {
            let proxy = trees.get_proxy(key_of(index));
            if slot.is_some_and(|known| proxy.is_none_or(|proxy| proxy.collider != known.collider))
            {
                self.changes.removed.push(index);
                self.known_count -= 1;
                *slot = None;
            }
        }
        for tree_type in ColliderTreeType::ALL {
            for (id, proxy) in trees.tree_for_type(tree_type).proxies.iter() {
                let key = ColliderTreeProxyKey::new(ProxyId::new(id as u32), tree_type);
                self.note(trees, key, proxy, false);
            }
        }
    }

    /// Collects what is new of a proxy.
    fn note(
        &mut self,
        trees: &ColliderTrees,
        key: ColliderTreeProxyKey,
        proxy: &ColliderTreeProxy,
        has_moved: bool,
    ) {
        let index = index_of(key);
        let position = index as usize;
        if self.known.len() <= position {
            self.known.resize(position + 1, None);
        }
        let (before, now) = (self.known[position], known_of(key.tree_type(), proxy));
        if before.is_none() || has_moved {
            let Some(b) = box_of(trees, key) else { return };
            self.changes.set.push(index);
            self.changes.boxes.push(b);
        }
        if now.is_static != before.is_some_and(|known| known.is_static) {
            let Changes { to_static, to_moving, .. } = &mut self.changes;
            if now.is_static { to_static.push(index) } else { to_moving.push(index) }
        }
        self.known_count += usize::from(before.is_none());
        self.known[position] = Some(now);
    }

    /// Sends what was collected, and keeps the pairs of the answer.
    fn ask(&mut self) -> Result<(), Error> {
        self.pairs.clear();
        let Changes { set, boxes, removed, to_static, to_moving } = &self.changes;
        if set.is_empty() && removed.is_empty() && to_static.is_empty() && to_moving.is_empty() {
            return Ok(());
        }
        let edit = self.scene.get().edit().remove_all(removed).set_all(set, boxes);
        let edit = edit.make_all_static(to_static, true).make_all_static(to_moving, false);
        let answer = edit.commit(Report::Moved)?;
        answer.pairs().for_each_slice(|some| self.pairs.extend_from_slice(some));
        Ok(())
    }
}

fn known_of(tree_type: ColliderTreeType, proxy: &ColliderTreeProxy) -> Known {
    let is_static = tree_type == ColliderTreeType::Static && !proxy.is_sensor();
    Known { collider: proxy.collider, is_static }
}
