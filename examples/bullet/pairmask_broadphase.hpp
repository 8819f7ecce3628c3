// Pairmask as a broad phase of Bullet: boxes go into a persistent scene, pairs that begin and end come out and
// into Bullet's pair cache.
//
//     PairmaskBroadphase broadphase(pairmask::Session::connect().value());
//     btDiscreteDynamicsWorld world(&dispatcher, &broadphase, &solver, &configuration);
//
// Filters are the pair cache's, as with Bullet's own broad phases: groups and masks, or a callback of the program.
#ifndef PAIRMASK_BROADPHASE_HPP
#define PAIRMASK_BROADPHASE_HPP

#include <btBulletCollisionCommon.h>
#include <pairmask.hpp>

#include <memory>
#include <vector>

class PairmaskBroadphase : public btBroadphaseInterface {
public:
  // Boxes are sent with this much around them, in units of the world, and sent again only when they have left
  // that: a stack at rest, whose boxes jitter, costs nothing. The pair cache has near pairs too, as with
  // btDbvtBroadphase. A larger margin sends fewer boxes, and gives Bullet more pairs to look at: of 16,000 balls in
  // a pile 56,552 pairs overlap, 67,968 are in the cache with this margin, and 86,919 with btDbvtBroadphase.
  static constexpr btScalar MARGIN = btScalar(0.02);

  // `pairs` is the caller's; null for a cache of its own.
  explicit PairmaskBroadphase(pairmask::Session session, btOverlappingPairCache *pairs = nullptr,
                              btScalar margin = MARGIN);
  ~PairmaskBroadphase() override;

  btBroadphaseProxy *createProxy(const btVector3 &low, const btVector3 &high, int shape,
                                 void *user, int group, int mask,
                                 btDispatcher *dispatcher) override;
  void destroyProxy(btBroadphaseProxy *proxy, btDispatcher *dispatcher) override;
  void setAabb(btBroadphaseProxy *proxy, const btVector3 &low, const btVector3 &high,
               btDispatcher *dispatcher) override;
  void getAabb(btBroadphaseProxy *proxy, btVector3 &low, btVector3 &high) const override;

  // Sends what has changed, and informs the pair cache what began and ended.
  void calculateOverlappingPairs(btDispatcher *dispatcher) override;

  // Calls back for each box that the ray, with a box around it, hits. The order is by index, not along the ray.
  void rayTest(const btVector3 &from, const btVector3 &to, btBroadphaseRayCallback &callback,
               const btVector3 &low = btVector3(0, 0, 0),
               const btVector3 &high = btVector3(0, 0, 0)) override;
  void aabbTest(const btVector3 &low, const btVector3 &high,
                btBroadphaseAabbCallback &callback) override;

  btOverlappingPairCache *getOverlappingPairCache() override { return pairs_; }
  const btOverlappingPairCache *getOverlappingPairCache() const override { return pairs_; }
  void getBroadphaseAabb(btVector3 &low, btVector3 &high) const override;
  void printStats() override {}

  pm_served_by served_by() const { return session_.served_by(); }

private:
  struct Proxy;

  // Has the next edit set a box, with its margin.
  void send(Proxy &proxy);
  bool has_changes() const { return !changed_.empty() || !removed_.empty(); }
  // Sends what has changed, for an answer or for none.
  pairmask::Answer commit(pm_report report);
  // Calls `iterate(proxy)` for the boxes of the scene that some boxes overlap, each once.
  template <class F> void find(const std::vector<pairmask::Box> &boxes, F iterate);
  void begin_pair(std::uint32_t a, std::uint32_t b);
  void end_pair(std::uint32_t a, std::uint32_t b, btDispatcher *dispatcher);
  // Turns all pairs of now into those that began and ended, in the order in which they would have been reported.
  void resync(pairmask::Span<const pairmask::Pair> now, btDispatcher *dispatcher);

  pairmask::Session session_;
  pairmask::Scene scene_;
  btScalar margin_;
  std::unique_ptr<btOverlappingPairCache> own_pairs_;
  btOverlappingPairCache *pairs_;
  // By index; null where there is none.
  std::vector<std::unique_ptr<Proxy>> proxies_;
  std::vector<std::uint32_t> free_;
  // What the next edit sets and removes.
  std::vector<std::uint32_t> changed_;
  std::vector<pairmask::Box> boxes_;
  std::vector<std::uint32_t> removed_;
  // What queries have sent, and has not been reported yet.
  bool is_unreported_ = false;
  // What the scene has reported: pairs of now, regardless of what filters say, as (a << 32 | b), sorted.
  std::vector<std::uint64_t> reported_;
  std::vector<std::uint64_t> next_reported_;
};

#endif
