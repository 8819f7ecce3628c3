// Bullet on Pairmask against Bullet on its own broad phase: in each step the pair cache must be that of
// btDbvtBroadphase, and rays and boxes must find the same bodies.
//
//     check [STEPS] [PID]
//
// With the PID of a daemon, that is killed in the middle: no step may differ from those of a session in process.
#include "pairmask_broadphase.hpp"
#include "worlds.hpp"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <sys/types.h>
#include <utility>

namespace {

// Bodies of a scene.
constexpr int BODIES = 300;

using Pairs = std::set<std::pair<int, int>>;

// The pairs of a cache whose boxes overlap. It has some that do not: both broad phases keep boxes with a margin.
Pairs overlapping(btBroadphaseInterface &broadphase) {
  Pairs pairs;
  const auto &array = broadphase.getOverlappingPairCache()->getOverlappingPairArray();
  for (int i = 0; i < array.size(); i++) {
    const btBroadphaseProxy *a = array[i].m_pProxy0, *b = array[i].m_pProxy1;
    if (TestAabbAgainstAabb2(a->m_aabbMin, a->m_aabbMax, b->m_aabbMin, b->m_aabbMax)) {
      const int first = *static_cast<int *>(a->m_clientObject);
      const int second = *static_cast<int *>(b->m_clientObject);
      pairs.insert(std::minmax(first, second));
    }
  }
  return pairs;
}

// A broad phase beside that of a simulation, which gets the same boxes.
class Shadow {
public:
  ~Shadow() {
    for (auto &entry : entries_) {
      own.destroyProxy(entry->proxy, nullptr);
      pairmask_->destroyProxy(entry->twin, nullptr);
    }
  }
  explicit Shadow(PairmaskBroadphase &pairmask) : pairmask_(&pairmask) {}

  // Gives both the boxes of a simulation's bodies.
  void follow(const Simulation &simulation) {
    const auto &bodies = simulation.bodies();
    while (entries_.size() > bodies.size()) {
      drop_last();
    }
    for (std::size_t i = 0; i < bodies.size(); i++) {
      btVector3 low, high;
      bodies[i]->getAabb(low, high);
      const btBroadphaseProxy *like = bodies[i]->getBroadphaseHandle();
      if (i == entries_.size()) {
        auto entry = std::make_unique<Entry>();
        entry->number = static_cast<int>(i);
        entry->proxy = create(own, *entry, low, high, *like);
        entry->twin = create(*pairmask_, *entry, low, high, *like);
        entries_.push_back(std::move(entry));
      } else {
        own.setAabb(entries_[i]->proxy, low, high, nullptr);
        pairmask_->setAabb(entries_[i]->twin, low, high, nullptr);
      }
    }
    own.calculateOverlappingPairs(nullptr);
    pairmask_->calculateOverlappingPairs(nullptr);
  }

  btDbvtBroadphase own;

private:
  struct Entry {
    int number;
    btBroadphaseProxy *proxy, *twin;
  };

  static btBroadphaseProxy *create(btBroadphaseInterface &broadphase, Entry &entry,
                                   const btVector3 &low, const btVector3 &high,
                                   const btBroadphaseProxy &like) {
    return broadphase.createProxy(low, high, BOX_SHAPE_PROXYTYPE, &entry.number,
                                  like.m_collisionFilterGroup, like.m_collisionFilterMask, nullptr);
  }
  void drop_last() {
    own.destroyProxy(entries_.back()->proxy, nullptr);
    pairmask_->destroyProxy(entries_.back()->twin, nullptr);
    entries_.pop_back();
  }

  PairmaskBroadphase *pairmask_;
  std::vector<std::unique_ptr<Entry>> entries_;
};

struct Collect : btBroadphaseAabbCallback {
  std::set<int> found;
  bool process(const btBroadphaseProxy *proxy) override {
    found.insert(*static_cast<int *>(proxy->m_clientObject));
    return true;
  }
};

struct CollectRay : btBroadphaseRayCallback {
  std::set<int> found;
  CollectRay(const btVector3 &from, const btVector3 &to) {
    const btVector3 way = to - from;
    const btVector3 direction = way.normalized();
    for (int axis = 0; axis < 3; axis++) {
      m_rayDirectionInverse[axis] =
          direction[axis] == 0 ? btScalar(BT_LARGE_FLOAT) : 1 / direction[axis];
      m_signs[axis] = m_rayDirectionInverse[axis] < 0;
    }
    m_lambda_max = direction.dot(way);
  }
  bool process(const btBroadphaseProxy *proxy) override {
    // A btDbvtBroadphase asks its fat boxes: what the ray does not hit is left out.
    found.insert(*static_cast<int *>(proxy->m_clientObject));
    return true;
  }
};

[[noreturn]] void fail(SceneName scene, int step, const char *what) {
  std::fprintf(stderr, "%s, step %d: %s\n", name_of(scene), step, what);
  std::exit(1);
}

void check_queries(SceneName scene, int step, Shadow &shadow, PairmaskBroadphase &pairmask) {
  const btScalar at = btScalar(step % 17);
  const btVector3 from(-5, 8, at), to(20, btScalar(0.25), at / 2);
  CollectRay ray(from, to), own_ray(from, to);
  pairmask.rayTest(from, to, ray);
  shadow.own.rayTest(from, to, own_ray);
  for (const int number : ray.found) {
    if (own_ray.found.count(number) == 0) {
      fail(scene, step, "a ray has found what Bullet's own does not");
    }
  }
  const btVector3 low(at, 0, at), high(at + 3, 2, at + 3);
  Collect box, own_box;
  pairmask.aabbTest(low, high, box);
  shadow.own.aabbTest(low, high, own_box);
  for (const int number : box.found) {
    if (own_box.found.count(number) == 0) {
      fail(scene, step, "a box has found what Bullet's own does not");
    }
  }
  if (step == 0 && (box.found.empty() || ray.found.empty())) {
    fail(scene, step, "nothing was found: the test tests nothing");
  }
}

std::vector<std::uint64_t> simulate(pm_backend backend, SceneName scene, int steps, pid_t killed) {
  pairmask::SessionOptions options;
  options.backend = backend;
  PairmaskBroadphase broadphase(pairmask::Session::connect(options).value());
  std::vector<std::uint64_t> prints;
  Simulation simulation(broadphase, scene, BODIES);
  for (int step = 0; step < steps; step++) {
    if (step == steps / 2 && killed > 0) {
      if (broadphase.served_by() != PM_SERVED_BY_DAEMON || kill(killed, SIGKILL) != 0) {
        fail(scene, step, "the daemon is not there to be killed");
      }
    }
    simulation.step();
    prints.push_back(simulation.fingerprint());
  }
  return prints;
}

} // namespace

int main(int argc, char **argv) {
  const int steps = argc > 1 ? std::atoi(argv[1]) : 1000;
  const pid_t daemon = argc > 2 ? std::atoi(argv[2]) : 0;
  if (daemon > 0) {
    const auto here = simulate(PM_BACKEND_IN_PROCESS, SceneName::Rain, steps, 0);
    const auto killed = simulate(PM_BACKEND_AUTO, SceneName::Rain, steps, daemon);
    if (here != killed) {
      fail(SceneName::Rain, steps, "a step differs after the daemon was killed");
    }
    std::printf("rain: %d steps, the daemon killed in the middle, no step differs\n", steps);
    return 0;
  }
  pairmask::SessionOptions options;
  options.backend = PM_BACKEND_IN_PROCESS;
  for (const SceneName scene : ALL_SCENES) {
    PairmaskBroadphase engine(pairmask::Session::connect(options).value());
    PairmaskBroadphase twin(pairmask::Session::connect(options).value());
    Simulation simulation(engine, scene, BODIES);
    Shadow shadow(twin);
    std::size_t most = 0;
    for (int step = 0; step < steps; step++) {
      simulation.step();
      shadow.follow(simulation);
      const Pairs found = overlapping(twin);
      if (found != overlapping(shadow.own)) {
        fail(scene, step, "the pair caches differ");
      }
      most = std::max(most, found.size());
      check_queries(scene, step, shadow, twin);
    }
    if (most < BODIES) {
      fail(scene, steps, "hardly any pairs: the test tests nothing");
    }
    std::printf("%s: %d steps, up to %zu pairs, the same as btDbvtBroadphase's\n", name_of(scene),
                steps, most);
  }
  return 0;
}
