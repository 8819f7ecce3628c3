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
// Threads, pointers and codes are as pairmask.h says. Licence: MIT OR Apache-2.0.
#ifndef PAIRMASK_HPP
#define PAIRMASK_HPP

#include "pairmask.h"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#if defined(__cpp_exceptions) || defined(_CPPUNWIND)
#define PAIRMASK_HAS_EXCEPTIONS 1
#include <exception>
#include <stdexcept>
#else
#define PAIRMASK_HAS_EXCEPTIONS 0
#endif

namespace pairmask {

using Box = pm_box;
using Sphere = pm_sphere;
using Pair = pm_pair;
using Ended = pm_ended;
using Range = pm_range;
using Tag = pm_tag;
using Filter = pm_filter;
using Precision = pm_precision;
using Placement = pm_placement;
using FrameInfo = pm_frame_info;
using DaemonStatus = pm_daemon_status;
using Indices = pm_indices;

enum class Backend : std::uint32_t {
  Auto = PM_BACKEND_AUTO,
  Daemon = PM_BACKEND_DAEMON,
  InProcess = PM_BACKEND_IN_PROCESS,
};

enum class ServedBy : std::uint32_t {
  Daemon = PM_SERVED_BY_DAEMON,
  ThisProcess = PM_SERVED_BY_THIS_PROCESS,
};

enum class Report : std::uint32_t {
  Changes = PM_REPORT_CHANGES,
  Moved = PM_REPORT_MOVED,
  All = PM_REPORT_ALL,
  Nothing = PM_REPORT_NOTHING,
};

// An array that somebody else owns. It converts to std::span where there is one.
template <class T> class Span {
public:
  using element_type = T;
  using value_type = std::remove_cv_t<T>;
  using iterator = T *;

  constexpr Span() noexcept = default;
  constexpr Span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
  // Whatever has data() and size(): vectors, arrays, strings, std::span.
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

// Why a call did nothing.
#if PAIRMASK_HAS_EXCEPTIONS
class Error : public std::exception {
#else
class Error {
#endif
public:
  Error(pm_code code, std::string text) : code_(code), text_(std::move(text)) {}
  // The error of the call that has just failed on this thread.
  static Error last(pm_code code) { return Error(code, pm_last_error()); }

  pm_code code() const noexcept { return code_; }
  const char *name() const noexcept { return pm_code_name(code_); }
#if PAIRMASK_HAS_EXCEPTIONS
  const char *what() const noexcept override { return text_.c_str(); }
#else
  const char *what() const noexcept { return text_.c_str(); }
#endif

private:
  pm_code code_;
  std::string text_;
};

namespace detail {

[[noreturn]] inline void fail(const Error &error) {
#if PAIRMASK_HAS_EXCEPTIONS
  throw error;
#else
  std::fprintf(stderr, "pairmask: %s: %s\n", error.name(), error.what());
  std::abort();
#endif
}

} // namespace detail

// A value, or why there is none.
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
      detail::fail(error_);
    }
  }

  T value_{};
  Error error_;
};

template <> class [[nodiscard]] Result<void> {
public:
  Result() : error_(PM_OK, std::string()) {}
  Result(Error error) : error_(std::move(error)) {}

  explicit operator bool() const noexcept { return error_.code() == PM_OK; }
  const Error &error() const noexcept { return error_; }
  void value() const {
    if (!*this) {
      detail::fail(error_);
    }
  }

private:
  Error error_;
};

namespace detail {

inline Result<void> done(pm_code code) {
  return code == PM_OK ? Result<void>() : Result<void>(Error::last(code));
}

// A struct that may grow, with its size.
template <class T> T sized() noexcept {
  T value{};
  value.struct_size = sizeof(T);
  return value;
}

// A handle, dropped with its owner.
template <class H, pm_code (*Drop)(H)> class Handle {
public:
  Handle() noexcept = default;
  explicit Handle(H handle) noexcept : handle_(handle) {}
  Handle(const Handle &) = delete;
  Handle &operator=(const Handle &) = delete;
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
  H release() noexcept {
    H handle = handle_;
    handle_ = H{};
    return handle;
  }

private:
  H handle_{};
};

// Calls a function object with spans, through a callback of C. An exception is kept, and thrown again once no
// frame of the library is between.
template <class T, class F> struct Visit {
  F &visit;
#if PAIRMASK_HAS_EXCEPTIONS
  std::exception_ptr thrown = nullptr;
#endif

  static void call(void *user, const T *values, std::size_t count) noexcept {
    auto *self = static_cast<Visit *>(user);
#if PAIRMASK_HAS_EXCEPTIONS
    if (self->thrown) {
      return;
    }
    try {
      self->visit(Span<const T>(values, count));
    } catch (...) {
      self->thrown = std::current_exception();
    }
#else
    self->visit(Span<const T>(values, count));
#endif
  }

  Result<void> end(pm_code code) {
#if PAIRMASK_HAS_EXCEPTIONS
    if (thrown) {
      std::rethrow_exception(thrown);
    }
#endif
    return done(code);
  }
};

} // namespace detail

// The version of the library that was loaded.
inline std::uint32_t version() noexcept { return pm_version(); }

inline constexpr Box box(float x0, float y0, float z0, float x1, float y1, float z1) noexcept {
  return Box{{x0, y0, z0}, {x1, y1, z1}};
}

// What a box touches on its way from one place to another.
inline Box swept(const Box &from, const Box &to) noexcept {
  Box b{};
  pm_box_swept(&from, &to, &b);
  return b;
}

// The f32 box around a box in f64, relative to `origin`, rounded outward.
inline Box outward(const double (&min)[3], const double (&max)[3],
                   const double (&origin)[3]) noexcept {
  Box b{};
  pm_box_outward(min, max, origin, &b);
  return b;
}

inline Indices index(std::uint32_t index) noexcept { return pm_index(index); }
inline Indices range(std::uint32_t first, std::size_t count) noexcept {
  return pm_index_range(first, count);
}
// The list is read where it lies, until the edit is answered.
inline Indices list(Span<const std::uint32_t> indices) noexcept {
  return pm_index_list(indices.data(), indices.size());
}

// Which boxes of a frame may be a pair at all.
class Rules {
public:
  Rules() = default;
  static Result<Rules> create(Span<const Tag> tags, Span<const Filter> filters = {},
                              Span<const Pair> included = {}, Span<const Pair> excluded = {}) {
    auto desc = detail::sized<pm_rules_desc>();
    desc.tags = tags.data();
    desc.tag_count = tags.size();
    desc.filters = filters.data();
    desc.filter_count = filters.size();
    desc.included = included.data();
    desc.included_count = included.size();
    desc.excluded = excluded.data();
    desc.excluded_count = excluded.size();
    pm_rules handle{};
    const pm_code code = pm_rules_create(&desc, &handle);
    if (code != PM_OK) {
      return Error::last(code);
    }
    Rules rules;
    rules.handle_ = detail::Handle<pm_rules, pm_rules_drop>(handle);
    return rules;
  }
  pm_rules get() const noexcept { return handle_.get(); }

private:
  detail::Handle<pm_rules, pm_rules_drop> handle_;
};

// The overlapping pairs of a frame.
class Mask {
public:
  Mask() = default;
  explicit Mask(pm_mask handle) noexcept : handle_(handle) {}

  pm_mask get() const noexcept { return handle_.get(); }
  std::uint64_t count() const noexcept {
    std::uint64_t count = 0;
    pm_mask_count(get(), &count);
    return count;
  }
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
  // Calls `visit(Span<const Pair>)` until all pairs were seen, without a copy of the mask.
  template <class F> Result<void> for_each(F &&visit) const {
    detail::Visit<Pair, F> visitor{visit};
    return visitor.end(pm_mask_for_each(get(), detail::Visit<Pair, F>::call, &visitor));
  }
  // Calls `visit(Span<const pm_word>)` with the words that are not zero.
  template <class F> Result<void> for_each_word(F &&visit) const {
    detail::Visit<pm_word, F> visitor{visit};
    return visitor.end(pm_mask_for_each_word(get(), detail::Visit<pm_word, F>::call, &visitor));
  }
  // The box index at each position of a sparse mask; empty where a position is an index.
  Span<const std::uint32_t> order() const noexcept {
    const std::uint32_t *order = nullptr;
    std::size_t count = 0;
    pm_mask_order(get(), &order, &count);
    return {order, count};
  }
  Result<Span<const Pair>> pairs_of_world(std::int32_t world) const {
    const Pair *pairs = nullptr;
    std::size_t count = 0;
    const pm_code code = pm_mask_pairs_of_world(get(), world, &pairs, &count);
    if (code != PM_OK) {
      return Error::last(code);
    }
    return Span<const Pair>(pairs, count);
  }
  FrameInfo info() const noexcept {
    auto info = detail::sized<FrameInfo>();
    pm_mask_info(get(), &info);
    return info;
  }

private:
  detail::Handle<pm_mask, pm_mask_drop> handle_;
};

// A frame under way.
class PendingFrame {
public:
  PendingFrame() = default;
  explicit PendingFrame(pm_pending handle) noexcept : handle_(handle) {}

  // Waits as long as the session's deadline allows. This object is empty then.
  Result<Mask> wait() {
    pm_mask mask{};
    const pm_code code = pm_pending_wait(handle_.release(), &mask);
    return code == PM_OK ? Result<Mask>(Mask(mask)) : Result<Mask>(Error::last(code));
  }
  // Waits at most so long. After PM_ERR_TIMEOUT and PM_ERR_BUSY the frame is still under way.
  Result<Mask> wait_for(std::uint64_t nanoseconds) {
    pm_mask mask{};
    const pm_code code = pm_pending_wait_timeout(handle_.get(), nanoseconds, &mask);
    if (code != PM_ERR_TIMEOUT && code != PM_ERR_BUSY && code != PM_ERR_ARGUMENT) {
      handle_.release();
    }
    return code == PM_OK ? Result<Mask>(Mask(mask)) : Result<Mask>(Error::last(code));
  }

private:
  detail::Handle<pm_pending, pm_pending_drop> handle_;
};

// What is asked of a frame beside its pairs: collision filters, which a daemon gets once, or two sets, in which only
// pairs of one of the first `split_at` boxes and one of the others count.
struct FrameOptions {
  const Rules *filters = nullptr;
  std::optional<std::uint32_t> split_at = std::nullopt;
};

// Memory for the boxes or spheres of one frame.
class Frame {
public:
  Frame() = default;
  explicit Frame(pm_frame handle) noexcept : handle_(handle) {}

  // The boxes where they lie; none of a narrow frame or one of spheres.
  Span<Box> boxes() noexcept {
    Box *boxes = nullptr;
    std::size_t n = 0;
    pm_frame_boxes(handle_.get(), &boxes, &n);
    return {boxes, n};
  }
  // The spheres where they lie; none of other frames.
  Span<Sphere> spheres() noexcept {
    Sphere *spheres = nullptr;
    std::size_t n = 0;
    pm_frame_spheres(handle_.get(), &spheres, &n);
    return {spheres, n};
  }
  Result<void> write(Span<const Box> boxes) {
    return detail::done(pm_frame_write(handle_.get(), boxes.data(), boxes.size()));
  }
  // Smallest and largest corners, three floats each.
  Result<void> write_corners(const float *min, const float *max, std::size_t n) {
    return detail::done(pm_frame_write_corners(handle_.get(), min, max, n));
  }
  // Centres and half extents, three floats each.
  Result<void> write_centers(const float *center, const float *half, std::size_t n) {
    return detail::done(pm_frame_write_centers(handle_.get(), center, half, n));
  }
  // Boxes in their objects' own coordinates, and where the objects are: one for each box.
  Result<void> write_placed(Span<const Box> locals, const Placement *placements) {
    return detail::done(
        pm_frame_write_placed(handle_.get(), locals.data(), placements, locals.size()));
  }
  Result<void> set(std::uint32_t index, const Box &box) {
    return detail::done(pm_frame_set(handle_.get(), index, &box));
  }

  // Sends the frame, which is empty then, but where the filters are.
  Result<PendingFrame> submit(const FrameOptions &options = {}) && {
    pm_frame_options given{sizeof given, {0}, options.split_at ? 1u : 0u, options.split_at.value_or(0)};
    if (options.filters) {
      given.filters = options.filters->get();
      // No filters at all would be another question than the empty object's.
      if (given.filters.id == 0)
        return Result<PendingFrame>(Error(PM_ERR_HANDLE, "the filters are empty"));
    }
    pm_pending pending{};
    pm_code code = pm_frame_submit(handle_.release(), &given, &pending);
    return code == PM_OK ? Result<PendingFrame>(PendingFrame(pending))
                         : Result<PendingFrame>(Error::last(code));
  }

private:
  detail::Handle<pm_frame, pm_frame_drop> handle_;
};

// What a query of a scene has found: pairs of a query's number and an index.
class Found {
public:
  Found() = default;
  explicit Found(pm_found handle) noexcept : handle_(handle) {}

  Span<const Pair> pairs() const noexcept {
    const Pair *pairs = nullptr;
    std::size_t count = 0;
    pm_found_pairs(handle_.get(), &pairs, &count);
    return {pairs, count};
  }
  template <class F> Result<void> for_each(F &&visit) const {
    detail::Visit<Pair, F> visitor{visit};
    return visitor.end(pm_found_for_each(handle_.get(), detail::Visit<Pair, F>::call, &visitor));
  }

private:
  detail::Handle<pm_found, pm_found_drop> handle_;
};

// A scene that persists: edits go in, changes of pairs come out. What is set and so on is the edit that commit()
// sends; arrays are read where they lie until it is answered. An answer lives until the next call
// that writes or sends an edit, or that asks the scene something: query(), resync(), or a lease. Read begun() and ended() before: an answer
// that was waited for is acknowledged, and without one they fail.
class Scene {
public:
  Scene() = default;
  explicit Scene(pm_scene handle) noexcept : handle_(handle) {}
  pm_scene get() const noexcept { return handle_.get(); }

  Result<void> set(std::uint32_t index, const Box &box) {
    return detail::done(pm_scene_set(get(), index, &box));
  }
  Result<void> set(std::uint32_t index, const Box &box, float margin) {
    return detail::done(pm_scene_set_margined(get(), index, &box, margin));
  }
  Result<void> set_all(Indices indices, Span<const Box> boxes) {
    return detail::done(pm_scene_set_all(get(), indices, boxes.data(), boxes.size()));
  }
  // One margin for all, or one for each.
  Result<void> set_all(Indices indices, Span<const Box> boxes, Span<const float> margins) {
    return detail::done(pm_scene_set_all_margined(get(), indices, boxes.data(), boxes.size(),
                                                  margins.data(), margins.size()));
  }
  Result<void> remove(Indices indices) { return detail::done(pm_scene_remove(get(), indices)); }
  Result<void> switch_to(Indices indices, bool on) {
    return detail::done(pm_scene_switch(get(), indices, on));
  }
  Result<void> make_static(Indices indices, bool is_static) {
    return detail::done(pm_scene_make_static(get(), indices, is_static));
  }
  Result<void> tag(Indices indices, Span<const Tag> tags) {
    return detail::done(pm_scene_tag(get(), indices, tags.data(), tags.size()));
  }
  Result<void> filters(Span<const Filter> filters) {
    return detail::done(pm_scene_filters(get(), filters.data(), filters.size()));
  }
  Result<void> include(Span<const Pair> pairs, bool on = true) {
    return detail::done(pm_scene_include(get(), pairs.data(), pairs.size(), on));
  }
  Result<void> exclude(Span<const Pair> pairs, bool on = true) {
    return detail::done(pm_scene_exclude(get(), pairs.data(), pairs.size(), on));
  }
  Result<void> discard() { return detail::done(pm_scene_discard(get())); }

  Result<void> submit(Report report) {
    return detail::done(pm_scene_submit(get(), static_cast<pm_report>(report)));
  }
  Result<void> wait() { return detail::done(pm_scene_wait(get())); }
  Result<void> commit(Report report) {
    return detail::done(pm_scene_commit(get(), static_cast<pm_report>(report)));
  }
  pm_answer answer() const {
    auto answer = detail::sized<pm_answer>();
    const pm_code code = pm_scene_answer(get(), &answer);
    if (code != PM_OK)
      detail::fail(Error::last(code));
    return answer;
  }
  bool is_resync() const { return answer().is_resync != 0; }
  Span<const Pair> begun() const { return listed<Pair>(pm_scene_begun); }
  Span<const Pair> pairs() const { return listed<Pair>(pm_scene_pairs); }
  Span<const Ended> ended() const { return listed<Ended>(pm_scene_ended); }
  template <class F> Result<void> for_each_begun(F &&visit) const {
    detail::Visit<Pair, F> visitor{visit};
    return visitor.end(
        pm_scene_for_each_begun(get(), detail::Visit<Pair, F>::call, &visitor));
  }
  template <class F> Result<void> for_each_pair(F &&visit) const {
    detail::Visit<Pair, F> visitor{visit};
    return visitor.end(pm_scene_for_each_pair(get(), detail::Visit<Pair, F>::call, &visitor));
  }
  // Leases of writers that were late, of a shared scene.
  std::vector<Range> late() const { return ranges(pm_scene_late); }

  // The next changes are a resync.
  Result<void> resync() { return detail::done(pm_scene_resync(get())); }
  Result<Box> box(std::uint32_t index) {
    Box b{};
    const pm_code code = pm_scene_get(get(), index, &b);
    return code == PM_OK ? Result<Box>(b) : Result<Box>(Error::last(code));
  }
  pm_scene_info info() noexcept {
    auto info = detail::sized<pm_scene_info>();
    pm_scene_get_info(get(), &info);
    return info;
  }
  // No tags, one for all queries, or one for each.
  Result<Found> query(Span<const Box> boxes, Span<const Tag> tags = {}) {
    pm_found found{};
    const pm_code code =
        pm_scene_query(get(), boxes.data(), boxes.size(), tags.data(), tags.size(), &found);
    return code == PM_OK ? Result<Found>(Found(found)) : Result<Found>(Error::last(code));
  }

  // Of a shared scene.
  Result<void> lease(std::uint32_t first, std::uint32_t count) {
    return detail::done(pm_scene_lease(get(), Range{first, count}));
  }
  Result<Range> lease_any(std::uint32_t count) {
    Range range{};
    const pm_code code = pm_scene_lease_any(get(), count, &range);
    return code == PM_OK ? Result<Range>(range) : Result<Range>(Error::last(code));
  }
  Result<void> give_back(std::uint32_t first) {
    return detail::done(pm_scene_give_back(get(), first));
  }
  std::vector<Range> leases() const { return ranges(pm_scene_leases); }

private:
  template <class T>
  Span<const T> listed(pm_code (*read)(pm_scene, const T **, std::size_t *)) const {
    const T *items = nullptr;
    std::size_t count = 0;
    const pm_code code = read(get(), &items, &count);
    if (code != PM_OK)
      detail::fail(Error::last(code));
    return {items, count};
  }
  std::vector<Range> ranges(pm_code (*read)(pm_scene, Range *, std::size_t, std::size_t *)) const {
    std::size_t count = 0;
    std::vector<Range> ranges;
    if (read(get(), nullptr, 0, &count) == PM_OK) {
      ranges.resize(count);
      read(get(), ranges.data(), ranges.size(), &count);
    }
    return ranges;
  }

  detail::Handle<pm_scene, pm_scene_drop> handle_;
};

// Settings of a session. What is left out, the library chooses.
struct SessionOptions {
  Backend backend = Backend::Auto;
  const char *instance = nullptr;
  const char *runtime_dir = nullptr;
  const char *engine = nullptr;
  const char *encoding = nullptr;
  const char *isa = nullptr;
  std::uint32_t threads = 0;
  std::uint32_t visit_threads = 0;
  std::uint32_t capacity = 0;
  std::uint64_t spin_ns = 0;
  std::uint64_t deadline_ns = 0;
  bool answer_repeats = true;
};

// Settings of a scene. What is left out, the library chooses.
struct SceneOptions {
  std::uint32_t most_boxes = 0;
  std::uint32_t threads = 0;
  // With margins, a box is sent only when it has left its own.
  pm_margins margins = PM_MARGINS_NONE;
  float usual_margin = 0;
};

// What a member asks of a shared scene. What is left out, the first member or the daemon decides.
struct JoinOptions {
  std::uint64_t tick_deadline_ns = 0;
  std::uint32_t most_boxes = 0;
  pm_at_end at_end = PM_AT_END_ANY;
  bool all_pairs = false;
  // PM_MARGINS_NEAR for boxes with margins.
  pm_margins margins = PM_MARGINS_NONE;
  float usual_margin = 0;
};

// A client's connection to a daemon or to the engines of this process.
class Session {
public:
  Session() = default;

  static Result<Session> connect(const SessionOptions &options = {}) {
    if (pm_version() >> 8 != PM_VERSION >> 8) {
      return Error(PM_ERR_VERSION_MISMATCH, "the library that was loaded is of another version "
                                            "than the header that this was compiled with");
    }
    auto given = detail::sized<pm_session_options>();
    given.backend = static_cast<pm_backend>(options.backend);
    given.instance = options.instance;
    given.runtime_dir = options.runtime_dir;
    given.engine = options.engine;
    given.encoding = options.encoding;
    given.isa = options.isa;
    given.threads = options.threads;
    given.visit_threads = options.visit_threads;
    given.capacity = options.capacity;
    given.spin_ns = options.spin_ns;
    given.deadline_ns = options.deadline_ns;
    given.no_repeats = options.answer_repeats ? 0 : 1;
    pm_session handle{};
    const pm_code code = pm_session_connect(&given, &handle);
    if (code != PM_OK) {
      return Error::last(code);
    }
    Session session;
    session.handle_ = detail::Handle<pm_session, pm_session_drop>(handle);
    return session;
  }

  pm_session get() const noexcept { return handle_.get(); }
  pm_session release() noexcept { return handle_.release(); }

  Result<Frame> frame(std::size_t n) {
    pm_frame frame{};
    return made<Frame>(pm_session_frame(get(), n, &frame, nullptr), frame);
  }
  Result<Frame> sphere_frame(std::size_t n) {
    pm_frame frame{};
    return made<Frame>(pm_session_sphere_frame(get(), n, &frame, nullptr), frame);
  }
  Result<Frame> narrow_frame(std::size_t n, const Precision &precision) {
    pm_frame frame{};
    return made<Frame>(pm_session_narrow_frame(get(), n, &precision, &frame), frame);
  }
  // Copies boxes, sends them and waits.
  Result<Mask> cull(Span<const Box> boxes, const Rules &rules = {}) {
    pm_mask mask{};
    return made<Mask>(pm_session_cull(get(), boxes.data(), boxes.size(), rules.get(), &mask), mask);
  }
  Result<Scene> scene(const SceneOptions &options = {}) {
    auto given = detail::sized<pm_scene_options>();
    given.most_boxes = options.most_boxes;
    given.threads = options.threads;
    given.margins = options.margins;
    given.usual_margin = options.usual_margin;
    pm_scene scene{};
    return made<Scene>(pm_scene_create(get(), &given, &scene), scene);
  }
  Result<Scene> join_scene(const char *name, const JoinOptions &options = {}) {
    auto given = detail::sized<pm_join_options>();
    given.tick_deadline_ns = options.tick_deadline_ns;
    given.most_boxes = options.most_boxes;
    given.at_end = options.at_end;
    given.all_pairs = options.all_pairs ? 1 : 0;
    given.margins = options.margins;
    given.usual_margin = options.usual_margin;
    pm_scene scene{};
    return made<Scene>(pm_scene_join(get(), name, &given, &scene), scene);
  }
  ServedBy served_by() const noexcept {
    pm_served_by by = PM_SERVED_BY_THIS_PROCESS;
    pm_session_served_by(get(), &by);
    return static_cast<ServedBy>(by);
  }
  Result<DaemonStatus> daemon_status() {
    auto status = detail::sized<DaemonStatus>();
    const pm_code code = pm_session_daemon_status(get(), &status);
    return code == PM_OK ? Result<DaemonStatus>(status) : Result<DaemonStatus>(Error::last(code));
  }

private:
  template <class T, class H> static Result<T> made(pm_code code, H handle) {
    return code == PM_OK ? Result<T>(T(handle)) : Result<T>(Error::last(code));
  }

  detail::Handle<pm_session, pm_session_drop> handle_;
};

} // namespace pairmask

#endif
