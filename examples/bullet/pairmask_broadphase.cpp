#include "pairmask_broadphase.hpp"

#include <LinearMath/btAabbUtil2.h>

#include <algorithm>
#include <iterator>

namespace {

// A place in the list of what the next edit sets, for a proxy that is not there.
constexpr std::uint32_t NOWHERE = UINT32_MAX;

// Pieces that a ray is asked in: the box around a long diagonal ray overlaps nearly everything, those around its
// pieces do not.
constexpr int RAY_PIECES = 32;

// Bullet's box in f32. In double precision it is rounded outward, so that no pair is lost.
pairmask::Box box_of(const btVector3 &low, const btVector3 &high) {
  if constexpr (sizeof(btScalar) == sizeof(double)) {
    return pairmask::outward({low.x(), low.y(), low.z()}, {high.x(), high.y(), high.z()}, {0, 0, 0});
  } else {
    return pairmask::box(static_cast<float>(low.x()), static_cast<float>(low.y()),
                         static_cast<float>(low.z()), static_cast<float>(high.x()),
                         static_cast<float>(high.y()), static_cast<float>(high.z()));
  }
}

constexpr std::uint64_t key(std::uint32_t a, std::uint32_t b) {
  return static_cast<std::uint64_t>(a) << 32 | b;
}

} // namespace

struct PairmaskBroadphase::Proxy : btBroadphaseProxy {
  Proxy(const btVector3 &low, const btVector3 &high, void *user, int group, int mask,
        std::uint32_t index)
      : btBroadphaseProxy(low, high, user, group, mask), index(index) {
    // Bullet orders pairs by this number. 0 is none.
    m_uniqueId = static_cast<int>(index) + 1;
  }

  bool is_within_sent() const {
    return sent_low.x() <= m_aabbMin.x() && sent_low.y() <= m_aabbMin.y() &&
           sent_low.z() <= m_aabbMin.z() && sent_high.x() >= m_aabbMax.x() &&
           sent_high.y() >= m_aabbMax.y() && sent_high.z() >= m_aabbMax.z();
  }

  std::uint32_t index;
  // The box that the scene has, or gets by the next edit.
  btVector3 sent_low, sent_high;
  // Its place in the list of what the next edit sets.
  std::uint32_t changed = NOWHERE;
};

PairmaskBroadphase::PairmaskBroadphase(pairmask::Session session, btOverlappingPairCache *pairs,
                                       btScalar margin)
    : session_(std::move(session)), scene_(session_.scene().value()), margin_(margin),
      pairs_(pairs) {
  if (pairs_ == nullptr) {
    own_pairs_ = std::make_unique<btHashedOverlappingPairCache>();
    pairs_ = own_pairs_.get();
  }
}

PairmaskBroadphase::~PairmaskBroadphase() = default;

btBroadphaseProxy *PairmaskBroadphase::createProxy(const btVector3 &low, const btVector3 &high, int,
                                                   void *user, int group, int mask,
                                                   btDispatcher *) {
  std::uint32_t index;
  if (free_.empty()) {
    index = static_cast<std::uint32_t>(proxies_.size());
    proxies_.emplace_back();
  } else {
    index = free_.back();
    free_.pop_back();
  }
  proxies_[index] = std::make_unique<Proxy>(low, high, user, group, mask, index);
  send(*proxies_[index]);
  return proxies_[index].get();
}

void PairmaskBroadphase::send(Proxy &proxy) {
  const btVector3 around(margin_, margin_, margin_);
  proxy.sent_low = proxy.m_aabbMin - around;
  proxy.sent_high = proxy.m_aabbMax + around;
  if (proxy.changed == NOWHERE) {
    proxy.changed = static_cast<std::uint32_t>(changed_.size());
    changed_.push_back(proxy.index);
    boxes_.emplace_back();
  }
  boxes_[proxy.changed] = box_of(proxy.sent_low, proxy.sent_high);
}

void PairmaskBroadphase::destroyProxy(btBroadphaseProxy *given, btDispatcher *dispatcher) {
  auto *proxy = static_cast<Proxy *>(given);
  pairs_->removeOverlappingPairsContainingProxy(proxy, dispatcher);
  const std::uint32_t box_at = proxy->changed;
  if (box_at != NOWHERE) {
    // The last of the list takes its place.
    changed_[box_at] = changed_.back();
    boxes_[box_at] = boxes_.back();
    if (changed_[box_at] != proxy->index) {
      proxies_[changed_[box_at]]->changed = box_at;
    }
    changed_.pop_back();
    boxes_.pop_back();
  }
  // One that the scene has not seen yet is removed by not being set. `removed_` is checked when it is sent.
  removed_.push_back(proxy->index);
  free_.push_back(proxy->index);
  proxies_[proxy->index].reset();
}

void PairmaskBroadphase::setAabb(btBroadphaseProxy *given, const btVector3 &low,
                                 const btVector3 &high, btDispatcher *) {
  auto *proxy = static_cast<Proxy *>(given);
  proxy->m_aabbMin = low;
  proxy->m_aabbMax = high;
  if (!proxy->is_within_sent()) {
    send(*proxy);
  }
}

void PairmaskBroadphase::getAabb(btBroadphaseProxy *proxy, btVector3 &low, btVector3 &high) const {
  low = proxy->m_aabbMin;
  high = proxy->m_aabbMax;
}

pairmask::Answer PairmaskBroadphase::commit(pm_report report) {
  if (!removed_.empty()) {
    std::sort(removed_.begin(), removed_.end());
    removed_.erase(std::unique(removed_.begin(), removed_.end()), removed_.end());
    // What was made and destroyed since the last edit is not in the scene.
    const auto is_absent = [this](std::uint32_t index) { return !scene_.box(index); };
    removed_.erase(std::remove_if(removed_.begin(), removed_.end(), is_absent), removed_.end());
    scene_.remove(pairmask::list(removed_)).value();
  }
  scene_.set_all(pairmask::list(changed_), boxes_).value();
  const auto answer = scene_.commit(report).value();
  for (const std::uint32_t index : changed_) {
    proxies_[index]->changed = NOWHERE;
  }
  changed_.clear();
  boxes_.clear();
  removed_.clear();
  return answer;
}

void PairmaskBroadphase::begin_pair(std::uint32_t a, std::uint32_t b) {
  // The cache asks the filters.
  pairs_->addOverlappingPair(proxies_[a].get(), proxies_[b].get());
}

void PairmaskBroadphase::end_pair(std::uint32_t a, std::uint32_t b, btDispatcher *dispatcher) {
  Proxy *first = proxies_[a].get();
  Proxy *second = proxies_[b].get();
  // A proxy that was destroyed has left the cache already.
  if (first != nullptr && second != nullptr) {
    pairs_->removeOverlappingPair(first, second, dispatcher);
  }
}

void PairmaskBroadphase::resync(pairmask::Span<const pairmask::Pair> now,
                                btDispatcher *dispatcher) {
  next_reported_.clear();
  for (const auto [a, b] : now) {
    next_reported_.push_back(key(a, b));
  }
  std::vector<std::uint64_t> changes;
  std::set_difference(reported_.begin(), reported_.end(), next_reported_.begin(), next_reported_.end(),
                      std::back_inserter(changes));
  for (const std::uint64_t pair : changes) {
    end_pair(static_cast<std::uint32_t>(pair >> 32), static_cast<std::uint32_t>(pair), dispatcher);
  }
  changes.clear();
  std::set_difference(next_reported_.begin(), next_reported_.end(), reported_.begin(), reported_.end(),
                      std::back_inserter(changes));
  for (const std::uint64_t pair : changes) {
    begin_pair(static_cast<std::uint32_t>(pair >> 32), static_cast<std::uint32_t>(pair));
  }
  reported_.swap(next_reported_);
}

void PairmaskBroadphase::calculateOverlappingPairs(btDispatcher *dispatcher) {
  if (!has_changes() && !is_unreported_) {
    return;
  }
  const auto answer = commit(PM_REPORT_CHANGES);
  is_unreported_ = false;
  if (answer.is_resync != 0) {
    resync(answer.pairs(), dispatcher);
  } else {
    const auto ended = answer.ended();
    const auto begun = answer.begun();
    for (const auto &pair : ended) {
      end_pair(pair.a, pair.b, dispatcher);
    }
    for (const auto [a, b] : begun) {
      begin_pair(a, b);
    }
    // All three lists are sorted: what was reported, without what ended, with what began.
    next_reported_.clear();
    auto end = ended.begin();
    auto next = begun.begin();
    for (const std::uint64_t pair : reported_) {
      while (next != begun.end() && key(next->a, next->b) < pair) {
        next_reported_.push_back(key(next->a, next->b));
        ++next;
      }
      if (end != ended.end() && key(end->a, end->b) == pair) {
        ++end;
      } else {
        next_reported_.push_back(pair);
      }
    }
    for (; next != begun.end(); ++next) {
      next_reported_.push_back(key(next->a, next->b));
    }
    reported_.swap(next_reported_);
  }
}

template <class F> void PairmaskBroadphase::find(const std::vector<pairmask::Box> &boxes, F iterate) {
  if (has_changes()) {
    // What began and ended by it is reported with the next changes.
    commit(PM_REPORT_NOTHING);
    is_unreported_ = true;
  }
  const auto found = scene_.query(boxes).value();
  std::vector<std::uint32_t> indices;
  for (const auto [query, index] : found) {
    indices.push_back(index);
  }
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  for (const std::uint32_t index : indices) {
    iterate(proxies_[index].get());
  }
}

void PairmaskBroadphase::rayTest(const btVector3 &from, const btVector3 &to,
                                 btBroadphaseRayCallback &callback, const btVector3 &low,
                                 const btVector3 &high) {
  std::vector<pairmask::Box> pieces;
  btVector3 start = from;
  for (int piece = 1; piece <= RAY_PIECES; piece++) {
    const btVector3 end =
        piece == RAY_PIECES ? to : from.lerp(to, btScalar(piece) / btScalar(RAY_PIECES));
    btVector3 smallest = start, largest = start;
    smallest.setMin(end);
    largest.setMax(end);
    pieces.push_back(box_of(smallest + low, largest + high));
    start = end;
  }
  find(pieces, [&](Proxy *proxy) {
    // As Bullet's own broad phases decide.
    const btVector3 bounds[2] = {proxy->m_aabbMin - high, proxy->m_aabbMax - low};
    btScalar hit = 0;
    if (btRayAabb2(from, callback.m_rayDirectionInverse, callback.m_signs, bounds, hit, 0,
                   callback.m_lambda_max)) {
      callback.process(proxy);
    }
  });
}

void PairmaskBroadphase::aabbTest(const btVector3 &low, const btVector3 &high,
                                  btBroadphaseAabbCallback &callback) {
  find({box_of(low, high)}, [&](Proxy *proxy) {
    if (TestAabbAgainstAabb2(low, high, proxy->m_aabbMin, proxy->m_aabbMax)) {
      callback.process(proxy);
    }
  });
}

void PairmaskBroadphase::getBroadphaseAabb(btVector3 &low, btVector3 &high) const {
  low.setValue(0, 0, 0);
  high.setValue(0, 0, 0);
  bool is_first = true;
  for (const auto &proxy : proxies_) {
    if (proxy == nullptr) {
      continue;
    }
    if (is_first) {
      low = proxy->m_aabbMin;
      high = proxy->m_aabbMax;
      is_first = false;
    } else {
      low.setMin(proxy->m_aabbMin);
      high.setMax(proxy->m_aabbMax);
    }
  }
}
