// Pairmask for C++17: which of many boxes overlap. Header only, on top of pairmask.h.
//
//     auto session = pairmask::Session::connect().value();
//     auto frame = session.frame(3).value();
//     for (pairmask::Box &box : frame.boxes()) { box = ...; }        // shared memory where a daemon serves
//     auto mask = std::move(frame).submit().value().wait().value();
//     for (auto [a, b] : mask.pairs()) { ... }
//
// Objects own what they name and drop it. They are moved, not copied, and empty after a move.
//
// Every call that may fail returns a Result: `if (result)` asks whether it holds a value, `*result` and
// `result->` use it, `result.error()` says why not. `result.value()` throws pairmask::Error where there is none,
// or, without exceptions, prints the error and aborts.
//
// Constants, threads, pointers and codes are as pairmask.h says. Licence: MIT OR Apache-2.0.
#ifndef PAIRMASK_HPP
#define PAIRMASK_HPP

#include "pairmask.h"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>

#if defined(__cpp_exceptions) || defined(_CPPUNWIND)
#define PAIRMASK_HAS_EXCEPTIONS 1
#else
#define PAIRMASK_HAS_EXCEPTIONS 0
#endif

namespace pairmask {

using Box = pm_box;
using Sphere = pm_sphere;
using Pair = pm_pair;
using Ray = pm_ray;
using Hit = pm_hit;
using Ended = pm_ended;
using Range = pm_range;
using FilterData = pm_filter_data;
using Filter = pm_filter;
using Precision = pm_precision;
using Placement = pm_placement;
using Indices = pm_indices;

// Which boxes a cast reports of each ray or sphere.
struct Hits {
  pm_hits kind;
  std::uint32_t most;

  static constexpr Hits all() noexcept { return {PM_HITS_ALL, 0}; }
  static constexpr Hits closest(std::uint32_t most) noexcept { return {PM_HITS_CLOSEST, most}; }
  static constexpr Hits any() noexcept { return {PM_HITS_ANY, 0}; }
};

// A struct that may grow, with its size, and zeros, as which it leaves all to the library.
template <class T> struct Sized : T {
  Sized() noexcept : T{} { this->struct_size = sizeof(T); }
};
using SessionOptions = Sized<pm_session_options>;
using SceneOptions = Sized<pm_scene_options>;
using JoinOptions = Sized<pm_join_options>;
using FrameInfo = Sized<pm_frame_info>;
using SceneInfo = Sized<pm_scene_info>;
using DaemonStatus = Sized<pm_daemon_status>;

// An array that somebody else owns. It converts to std::span where there is one.
template <class T> class Span {
public:
  using element_type = T;
  using value_type = std::remove_cv_t<T>;
  using iterator = T *;

  constexpr Span() noexcept = default;
  constexpr Span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
  // Anything that has data() and size(): vectors, arrays, strings, std::span.
  template <class C, class = std::enable_if_t<
                         !std::is_same_v<std::remove_cv_t<std::remove_reference_t<C>>, Span> &&
                         std::is_convertible_v<decltype(std::declval<C &>().data()), T *>>>
  constexpr Span(C &&values) noexcept : data_(values.data()), size_(values.size()) {}
  template <std::size_t N> constexpr Span(T (&values)[N]) noexcept : data_(values), size_(N) {}

  constexpr T *data() const noexcept { return data_; }
  constexpr std::size_t size() const noexcept { return size_; }
  constexpr bool empty() const noexcept { return size_ == 0; }
  constexpr T *begin() const noexcept { return data_; }
  constexpr T *end() const noexcept { return data_ + size_; }
  constexpr T &operator[](std::size_t at) const noexcept { return data_[at]; }

private:
  T *data_ = nullptr;
  std::size_t size_ = 0;
};

// The answer to an edit: pm_answer's facts, and its arrays as spans.
struct Answer : Sized<pm_answer> {
  Span<const Pair> begun() const noexcept { return {pm_answer::begun, begun_count}; }
  Span<const Ended> ended() const noexcept { return {pm_answer::ended, ended_count}; }
  Span<const Pair> pairs() const noexcept { return {pm_answer::pairs, pair_count}; }
  Span<const Range> late() const noexcept { return {pm_answer::late, late_count}; }
};

// Why a call did nothing.
class Error : public std::exception {
public:
  Error(pm_code code, std::string text) : code_(code), text_(std::move(text)) {}
  // The error of the call that has just failed on this thread.
  static Error last(pm_code code) { return Error(code, pm_last_error()); }

  pm_code code() const noexcept { return code_; }
  // The name of the code, and words.
  const char *what() const noexcept override { return text_.c_str(); }

private:
  pm_code code_;
  std::string text_;
};

// The value of what has none.
struct Done {};

// A value, or an error.
template <class T> class [[nodiscard]] Result {
public:
  Result(T value) : value_(std::move(value)), error_(PM_OK, std::string()) {}
  Result(Error error) : error_(std::move(error)) {}

  explicit operator bool() const noexcept { return error_.code() == PM_OK; }
  const Error &error() const noexcept { return error_; }
  T &operator*() & noexcept { return value_; }
  T &&operator*() && noexcept { return std::move(value_); }
  T *operator->() noexcept { return &value_; }
  T &value() & {
    check();
    return value_;
  }
  T value() && {
    check();
    return std::move(value_);
  }

private:
  void check() const {
    if (!*this) {
#if PAIRMASK_HAS_EXCEPTIONS
      throw error_;
#else
      std::fprintf(stderr, "pairmask: %s\n", error_.what());
      std::abort();
#endif
    }
  }

  T value_{};
  Error error_;
};

namespace detail {

// What a call has made, of what it wrote.
template <class T, class W> Result<T> made(pm_code code, const W &written) {
  return code == PM_OK ? Result<T>(T(written)) : Result<T>(Error::last(code));
}

// The same of a call that writes a W through its last pointer.
template <class T, class W, class... P, class... A> Result<T> make(pm_code (*call)(P...), A... given) {
  W written{};
  return made<T>(call(given..., &written), written);
}

inline Result<Done> done(pm_code code) { return made<Done>(code, Done()); }

// A handle, dropped with its owner.
template <class H, pm_code (*Drop)(H)> class Handle {
public:
  Handle() noexcept = default;
  explicit Handle(H handle) noexcept : handle_(handle) {}
  Handle(Handle &&other) noexcept : handle_(other.release()) {}
  Handle &operator=(Handle &&other) noexcept {
    if (this != &other) {
      Drop(handle_);
      handle_ = other.release();
    }
    return *this;
  }
  ~Handle() { Drop(handle_); }

  H get() const noexcept { return handle_; }
  H release() noexcept { return std::exchange(handle_, H{}); }

private:
  H handle_{};
};

// Calls a function object with spans, through a callback of C. An exception is stored, and thrown again once no
// stack frame of the library is between.
template <class T, class F> struct ForEach {
  F &iterate;
  std::exception_ptr thrown = nullptr;

  static void call(void *user, const T *values, std::size_t count) noexcept {
    auto *self = static_cast<ForEach *>(user);
#if PAIRMASK_HAS_EXCEPTIONS
    if (self->thrown) {
      return;
    }
    try {
      self->iterate(Span<const T>(values, count));
    } catch (...) {
      self->thrown = std::current_exception();
    }
#else
    self->iterate(Span<const T>(values, count));
#endif
  }

  Result<Done> end(pm_code code) {
    if (thrown) {
      std::rethrow_exception(thrown);
    }
    return done(code);
  }
};

} // namespace detail

inline constexpr Box box(float x0, float y0, float z0, float x1, float y1, float z1) noexcept {
  return Box{{x0, y0, z0}, {x1, y1, z1}};
}

// The f32 box around a box in f64, relative to `origin`, rounded outward.
inline Box outward(const double (&min)[3], const double (&max)[3],
                   const double (&origin)[3]) noexcept {
  Box b{};
  pm_box_outward(min, max, origin, &b);
  return b;
}

inline Indices range(std::uint32_t first, std::size_t count) noexcept {
  return {PM_INDICES_RANGE, first, count, nullptr};
}
inline Indices index(std::uint32_t index) noexcept { return range(index, 1); }
// The list is read where it lies, until the edit is answered.
inline Indices list(Span<const std::uint32_t> indices) noexcept {
  return {PM_INDICES_LIST, 0, indices.size(), indices.data()};
}

// Which boxes of a frame may be a pair at all.
class Rules : public detail::Handle<pm_rules, pm_rules_drop> {
public:
  using Handle::Handle;
  static Result<Rules> create(Span<const FilterData> filter_data, Span<const Filter> filters = {},
                              Span<const Pair> included = {}, Span<const Pair> excluded = {}) {
    const pm_rules_desc desc{sizeof desc, filter_data.data(), filter_data.size(), filters.data(), filters.size(),
                             included.data(), included.size(), excluded.data(), excluded.size()};
    return detail::make<Rules, pm_rules>(pm_rules_create, &desc);
  }
};

// The overlapping pairs of a frame.
class Mask : public detail::Handle<pm_mask, pm_mask_drop> {
public:
  using Handle::Handle;
  std::uint64_t count() const noexcept { return info().pair_count; }
  bool contains(std::uint32_t a, std::uint32_t b) const noexcept {
    bool contains = false;
    pm_mask_contains(get(), a, b, &contains);
    return contains;
  }
  // All pairs, decoded once; they live as long as the mask.
  Span<const Pair> pairs() const noexcept {
    const Pair *pairs = nullptr;
    std::size_t count = 0;
    pm_mask_pairs(get(), &pairs, &count);
    return {pairs, count};
  }
  Result<Span<const Pair>> pairs_of_world(std::int32_t world) const {
    const Pair *pairs = nullptr;
    std::size_t count = 0;
    const pm_code code = pm_mask_pairs_of_world(get(), world, &pairs, &count);
    return detail::made<Span<const Pair>>(code, Span<const Pair>(pairs, count));
  }
  // Calls `iterate(Span<const Pair>)` with all pairs, some at a time, without a copy of the mask.
  template <class F> Result<Done> for_each(F &&iterate) const {
    detail::ForEach<Pair, F> callback{iterate};
    return callback.end(pm_mask_for_each(get(), callback.call, &callback));
  }
  // Calls `iterate(Span<const pm_word>)` with the words that are not zero.
  template <class F> Result<Done> for_each_word(F &&iterate) const {
    detail::ForEach<pm_word, F> callback{iterate};
    return callback.end(pm_mask_for_each_word(get(), callback.call, &callback));
  }
  FrameInfo info() const noexcept {
    FrameInfo info;
    pm_mask_info(get(), &info);
    return info;
  }
};

// A frame under way.
class PendingFrame : public detail::Handle<pm_pending, pm_pending_drop> {
public:
  using Handle::Handle;
  // Waits as long as the session's deadline allows. This object is empty then.
  Result<Mask> wait() { return detail::make<Mask, pm_mask>(pm_pending_wait, release()); }
  // Waits at most so long. After PM_ERR_TIMEOUT and PM_ERR_BUSY the frame is still under way.
  Result<Mask> wait_for(std::uint64_t nanoseconds) {
    pm_mask mask{};
    const pm_code code = pm_pending_wait_timeout(get(), nanoseconds, &mask);
    if (code != PM_ERR_TIMEOUT && code != PM_ERR_BUSY && code != PM_ERR_ARGUMENT) {
      release();
    }
    return detail::made<Mask>(code, mask);
  }
};

// Either collision filters, which a daemon gets once, or two sets: then only pairs of one of the first
// `split_at` boxes and one of the others count.
struct FrameOptions {
  const Rules *filters = nullptr;
  std::optional<std::uint32_t> split_at = std::nullopt;
};

// Memory for the boxes or spheres of one frame.
class Frame : public detail::Handle<pm_frame, pm_frame_drop> {
public:
  Frame() = default;
  explicit Frame(pm_frame handle, Span<Box> boxes = {}, Span<Sphere> spheres = {}) noexcept
      : Handle(handle), boxes_(boxes), spheres_(spheres) {}

  // The boxes where they lie; none of a narrow frame or one of spheres.
  Span<Box> boxes() const noexcept { return get().id == 0 ? Span<Box>() : boxes_; }
  // The spheres where they lie; none of other frames.
  Span<Sphere> spheres() const noexcept { return get().id == 0 ? Span<Sphere>() : spheres_; }
  Result<Done> write(Span<const Box> boxes) {
    return detail::done(pm_frame_write(get(), boxes.data(), boxes.size()));
  }
  // Smallest and largest corners, three floats each.
  Result<Done> write_corners(const float *min, const float *max, std::size_t n) {
    return detail::done(pm_frame_write_corners(get(), min, max, n));
  }
  // Centres and half extents, three floats each.
  Result<Done> write_centers(const float *center, const float *half, std::size_t n) {
    return detail::done(pm_frame_write_centers(get(), center, half, n));
  }
  // Boxes in their objects' own coordinates, and where the objects are: one for each box.
  Result<Done> write_placed(Span<const Box> locals, const Placement *placements) {
    return detail::done(pm_frame_write_placed(get(), locals.data(), placements, locals.size()));
  }
  Result<Done> set(std::uint32_t index, const Box &box) {
    return detail::done(pm_frame_set(get(), index, &box));
  }

  // Sends the frame, which is empty then.
  Result<PendingFrame> submit(const FrameOptions &options = {}) && {
    pm_frame_options given{sizeof given, {0}, options.split_at ? 1u : 0u,
                           options.split_at.value_or(0)};
    if (options.filters) {
      given.filters = options.filters->get();
      // A zero would mean no filters, and not those of an object that was moved from.
      if (given.filters.id == 0) {
        return Error(PM_ERR_HANDLE, "the filters are empty");
      }
    }
    return detail::make<PendingFrame, pm_pending>(pm_frame_submit, release(), &given);
  }

private:
  Span<Box> boxes_;
  Span<Sphere> spheres_;
};

// A persistent scene: edits go in, changes of pairs come out. What is set and so on is the edit that
// commit() sends; arrays are read where they lie until it is answered. An answer is acknowledged by being
// waited for, and lives until the next call that writes or sends an edit, or that asks the scene something:
// query(), cast(), nearest(), shift_origin(), snapshot(), restore(), forget_snapshot(), save(), resync(), or a lease.
class Scene : public detail::Handle<pm_scene, pm_scene_drop> {
public:
  using Handle::Handle;
  Result<Done> set(std::uint32_t index, const Box &box) {
    return detail::done(pm_scene_set(get(), index, &box, nullptr));
  }
  Result<Done> set(std::uint32_t index, const Box &box, float margin) {
    return detail::done(pm_scene_set(get(), index, &box, &margin));
  }
  // With no margins, one for all, or one for each.
  Result<Done> set_all(Indices indices, Span<const Box> boxes, Span<const float> margins = {}) {
    return detail::done(pm_scene_set_all(get(), indices, boxes.data(), boxes.size(),
                                         margins.data(), margins.size()));
  }
  Result<Done> remove(Indices indices) { return detail::done(pm_scene_remove(get(), indices)); }
  Result<Done> set_enabled(Indices indices, bool on) {
    return detail::done(pm_scene_set_enabled(get(), indices, on));
  }
  Result<Done> make_static(Indices indices, bool is_static) {
    return detail::done(pm_scene_make_static(get(), indices, is_static));
  }
  // Gives boxes their filter data, one for each index: pm_scene_set_filter.
  Result<Done> set_filter(Indices indices, Span<const FilterData> filter_data) {
    return detail::done(pm_scene_set_filter(get(), indices, filter_data.data(), filter_data.size()));
  }
  // Gives boxes user data, one for each index: pm_scene_set_user_data.
  Result<Done> set_user_data(Indices indices, Span<const std::uint64_t> user_data) {
    return detail::done(pm_scene_set_user_data(get(), indices, user_data.data(), user_data.size()));
  }
  // The user data of indices: pm_scene_get_user_data. They live until the next call.
  Result<Span<const std::uint64_t>> user_data(Span<const std::uint32_t> indices) {
    const std::uint64_t *found = nullptr;
    const pm_code code = pm_scene_get_user_data(get(), indices.data(), indices.size(), &found);
    return detail::made<Span<const std::uint64_t>>(code, Span<const std::uint64_t>(found, indices.size()));
  }
  // The filters that filter data names, in place of all before: pm_scene_filter_table.
  Result<Done> filter_table(Span<const Filter> filters) {
    return detail::done(pm_scene_filter_table(get(), filters.data(), filters.size()));
  }
  Result<Done> include(Span<const Pair> pairs, bool on = true) {
    return detail::done(pm_scene_include(get(), pairs.data(), pairs.size(), on));
  }
  Result<Done> exclude(Span<const Pair> pairs, bool on = true) {
    return detail::done(pm_scene_exclude(get(), pairs.data(), pairs.size(), on));
  }
  Result<Done> discard() { return detail::done(pm_scene_discard(get())); }

  Result<Done> submit(pm_report report) { return detail::done(pm_scene_submit(get(), report)); }
  Result<Answer> wait() { return detail::make<Answer, Answer>(pm_scene_wait, get()); }
  Result<Answer> commit(pm_report report) {
    return detail::make<Answer, Answer>(pm_scene_commit, get(), report);
  }

  // The next changes are a resync.
  Result<Done> resync() { return detail::done(pm_scene_resync(get())); }
  Result<Box> box(std::uint32_t index) { return detail::make<Box, Box>(pm_scene_get, get(), index); }
  SceneInfo info() noexcept {
    SceneInfo info;
    pm_scene_get_info(get(), &info);
    return info;
  }
  // Pairs of a query's number and an index. With no filter data, which finds boxes of all worlds, one for all queries,
  // or one for each. What is found lives until the next query.
  Result<Span<const Pair>> query(Span<const Box> boxes, Span<const FilterData> filter_data = {}) {
    const Pair *found = nullptr;
    std::size_t count = 0;
    const pm_code code = pm_scene_query(get(), boxes.data(), boxes.size(), filter_data.data(),
                                        filter_data.size(), &found, &count);
    return detail::made<Span<const Pair>>(code, Span<const Pair>(found, count));
  }
  // Saves the scene in a file: pm_scene_save.
  Result<Done> save(const char *path) { return detail::done(pm_scene_save(get(), path)); }
  // Moves all boxes by a vector: pm_scene_shift_origin.
  Result<Done> shift_origin(float x, float y, float z) {
    const float by[3] = {x, y, z};
    return detail::done(pm_scene_shift_origin(get(), by));
  }
  // Takes a snapshot, and returns its number: pm_scene_take_snapshot.
  Result<std::uint64_t> snapshot() {
    std::uint64_t taken = 0;
    const pm_code code = pm_scene_take_snapshot(get(), &taken);
    return detail::made<std::uint64_t>(code, taken);
  }
  // Goes back to a snapshot: pm_scene_restore.
  Result<Done> restore(std::uint64_t snapshot) {
    return detail::done(pm_scene_restore(get(), snapshot));
  }
  // Forgets a snapshot: pm_scene_forget_snapshot.
  Result<Done> forget_snapshot(std::uint64_t snapshot) {
    return detail::done(pm_scene_forget_snapshot(get(), snapshot));
  }
  // The boxes that rays hit, by ray, by distance, and then by index: pm_scene_cast. What is found lives until the next
  // cast() or nearest().
  Result<Span<const Hit>> cast(Span<const Ray> rays, Hits hits,
                               Span<const FilterData> filter_data = {}) {
    const Hit *found = nullptr;
    std::size_t count = 0;
    const pm_code code = pm_scene_cast(get(), rays.data(), rays.size(), hits.kind, hits.most,
                                       filter_data.data(), filter_data.size(), &found, &count);
    return detail::made<Span<const Hit>>(code, Span<const Hit>(found, count));
  }
  // The boxes that spheres touch, the nearest to each center first: pm_scene_nearest.
  Result<Span<const Hit>> nearest(Span<const Sphere> spheres, Hits hits,
                                  Span<const FilterData> filter_data = {}) {
    const Hit *found = nullptr;
    std::size_t count = 0;
    const pm_code code = pm_scene_nearest(get(), spheres.data(), spheres.size(), hits.kind, hits.most,
                                          filter_data.data(), filter_data.size(), &found, &count);
    return detail::made<Span<const Hit>>(code, Span<const Hit>(found, count));
  }

  // Of a shared scene.
  Result<Done> lease(std::uint32_t first, std::uint32_t count) {
    return detail::done(pm_scene_lease(get(), Range{first, count}));
  }
  Result<Range> lease_any(std::uint32_t count) {
    return detail::make<Range, Range>(pm_scene_lease_any, get(), count);
  }
  Result<Done> give_back(std::uint32_t first) {
    return detail::done(pm_scene_give_back(get(), first));
  }
};

// A client's connection to a daemon or to the engines of this process.
class Session : public detail::Handle<pm_session, pm_session_drop> {
public:
  using Handle::Handle;
  static Result<Session> connect(const SessionOptions &options = {}) {
    if (pm_version() >> 8 != PM_VERSION >> 8) {
      return Error(PM_ERR_VERSION_MISMATCH, "the library that was loaded is of another version "
                                            "than the header that this was compiled with");
    }
    return detail::make<Session, pm_session>(pm_session_connect, &options);
  }

  Result<Frame> frame(std::size_t n) {
    pm_frame frame{};
    Box *boxes = nullptr;
    if (const pm_code code = pm_session_frame(get(), n, &frame, &boxes)) {
      return Error::last(code);
    }
    return Frame(frame, {boxes, n});
  }
  Result<Frame> sphere_frame(std::size_t n) {
    pm_frame frame{};
    Sphere *spheres = nullptr;
    if (const pm_code code = pm_session_sphere_frame(get(), n, &frame, &spheres)) {
      return Error::last(code);
    }
    return Frame(frame, {}, {spheres, n});
  }
  Result<Frame> narrow_frame(std::size_t n, const Precision &precision) {
    return detail::make<Frame, pm_frame>(pm_session_narrow_frame, get(), n, &precision);
  }
  // Copies boxes, sends them and waits.
  Result<Mask> cull(Span<const Box> boxes, const Rules &rules = {}) {
    return detail::make<Mask, pm_mask>(pm_session_cull, get(), boxes.data(), boxes.size(), rules.get());
  }
  Result<Scene> scene(const SceneOptions &options = {}) {
    return detail::make<Scene, pm_scene>(pm_scene_create, get(), &options);
  }
  // A scene that Scene::save has written.
  Result<Scene> load_scene(const char *path, const SceneOptions &options = {}) {
    return detail::make<Scene, pm_scene>(pm_session_load_scene, get(), &options, path);
  }
  Result<Scene> join_scene(const char *name, const JoinOptions &options = {}) {
    return detail::make<Scene, pm_scene>(pm_scene_join, get(), name, &options);
  }
  pm_served_by served_by() const noexcept {
    pm_served_by by = PM_SERVED_BY_THIS_PROCESS;
    pm_session_served_by(get(), &by);
    return by;
  }
  Result<DaemonStatus> daemon_status() {
    return detail::make<DaemonStatus, DaemonStatus>(pm_session_daemon_status, get());
  }
};

} // namespace pairmask

#endif
