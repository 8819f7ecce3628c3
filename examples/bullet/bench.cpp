// Time of a step, and of the broad phase in it, on Pairmask and on Bullet's own broad phases, in turns.
//
//     bench [MOST_BODIES] [BACKEND]
//
// Prints a line for each scene, number of bodies and broad phase: median times, ms, of a step, and in it of setting
// boxes and finding pairs. Bullet computes the boxes of shapes in that time: what is left of it with a broad phase
// that does nothing is reported as `none`.
#include "pairmask_broadphase.hpp"
#include "worlds.hpp"

#include <BulletCollision/BroadphaseCollision/btAxisSweep3.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

// Steps before the first that counts: bodies fall, and caches fill.
constexpr int WARM_UP = 20;
// Steps that count.
constexpr int STEPS = 60;
// Bodies up to which btAxisSweep3 is measured: more take it minutes to be added, since each goes through all of them.
constexpr int MOST_OF_SWEEP = 16000;

using Milliseconds = std::chrono::duration<double, std::milli>;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Keeps boxes, and finds nothing.
class NoBroadphase : public btBroadphaseInterface {
public:
  btBroadphaseProxy *createProxy(const btVector3 &low, const btVector3 &high, int, void *user,
                                 int group, int mask, btDispatcher *) override {
    proxies_.push_back(std::make_unique<btBroadphaseProxy>(low, high, user, group, mask));
    return proxies_.back().get();
  }
  void destroyProxy(btBroadphaseProxy *, btDispatcher *) override {}
  void setAabb(btBroadphaseProxy *proxy, const btVector3 &low, const btVector3 &high,
               btDispatcher *) override {
    proxy->m_aabbMin = low;
    proxy->m_aabbMax = high;
  }
  void getAabb(btBroadphaseProxy *, btVector3 &, btVector3 &) const override {}
  void rayTest(const btVector3 &, const btVector3 &, btBroadphaseRayCallback &, const btVector3 &,
               const btVector3 &) override {}
  void aabbTest(const btVector3 &, const btVector3 &, btBroadphaseAabbCallback &) override {}
  void calculateOverlappingPairs(btDispatcher *) override {}
  btOverlappingPairCache *getOverlappingPairCache() override { return &pairs_; }
  const btOverlappingPairCache *getOverlappingPairCache() const override { return &pairs_; }
  void getBroadphaseAabb(btVector3 &, btVector3 &) const override {}
  void printStats() override {}

private:
  std::vector<std::unique_ptr<btBroadphaseProxy>> proxies_;
  btHashedOverlappingPairCache pairs_;
};

struct Candidate {
  const char *name;
  std::unique_ptr<btBroadphaseInterface> broadphase;
  std::unique_ptr<Simulation> simulation;
  std::vector<double> step, broad;
};

} // namespace

int main(int argc, char **argv) {
  const int most = argc > 1 ? std::atoi(argv[1]) : 64000;
  pairmask::SessionOptions options;
  const bool is_daemon = argc > 2 && std::strcmp(argv[2], "daemon") == 0;
  options.backend = is_daemon ? PM_BACKEND_DAEMON : PM_BACKEND_IN_PROCESS;
  std::printf("%-8s %7s %-12s %10s %12s %6s\n", "scene", "bodies", "broad phase", "step, ms",
              "of that, ms", "pairs");
  for (const SceneName scene : {SceneName::Rain, SceneName::Stacks}) {
    for (int bodies = 1000; bodies <= most; bodies *= 4) {
      std::vector<Candidate> candidates;
      const auto add = [&](const char *name, std::unique_ptr<btBroadphaseInterface> broadphase) {
        candidates.push_back({name, std::move(broadphase), nullptr, {}, {}});
      };
      add("pairmask",
          std::make_unique<PairmaskBroadphase>(pairmask::Session::connect(options).value()));
      add("btDbvt", std::make_unique<btDbvtBroadphase>());
      if (bodies <= MOST_OF_SWEEP) {
        add("btAxisSweep3",
            std::make_unique<bt32BitAxisSweep3>(btVector3(-1100, -1100, -1100),
                                                btVector3(1100, 1100, 1100), MOST_OF_SWEEP * 2));
      }
      add("none", std::make_unique<NoBroadphase>());
      for (auto &candidate : candidates) {
        candidate.simulation = std::make_unique<Simulation>(*candidate.broadphase, scene, bodies);
      }
      for (int step = 0; step < WARM_UP + STEPS; step++) {
        for (auto &candidate : candidates) {
          auto &world = candidate.simulation->world;
          world.spent = {};
          const auto start = std::chrono::steady_clock::now();
          candidate.simulation->step();
          const auto taken = std::chrono::steady_clock::now() - start;
          if (step >= WARM_UP) {
            candidate.step.push_back(Milliseconds(taken).count());
            candidate.broad.push_back(Milliseconds(world.spent).count());
          }
        }
      }
      for (auto &candidate : candidates) {
        std::printf("%-8s %7d %-12s %10.2f %12.3f %6d\n", name_of(scene), bodies, candidate.name,
                    median(candidate.step), median(candidate.broad),
                    candidate.broadphase->getOverlappingPairCache()->getNumOverlappingPairs());
        candidate.simulation.reset();
      }
      std::fflush(stdout);
    }
  }
  return 0;
}
