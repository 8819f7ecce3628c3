// Every call of the C++ header, and what becomes of errors, with and without exceptions.
#include "pairmask.hpp"

#include "check.h"

#include <array>
#include <cstdio>
#include <limits>
#include <vector>
#if __cplusplus >= 202002L
#include <span>
#endif

namespace pm = pairmask;

namespace {

pm::Box at(float x) { return pm::box(x, 0, 0, x + 1, 1, 1); }

bool are(pm::Span<const pm::Pair> pairs, std::vector<std::array<std::uint32_t, 2>> expected) {
  std::vector<std::array<std::uint32_t, 2>> found;
  for (const auto [a, b] : pairs) {
    found.push_back({a, b});
  }
  return found == expected;
}

void frames(pm::Session &session) {
  const std::vector<pm::Box> three = {at(0), at(0.75f), at(1.5f)};
  auto frame = session.frame(3).value();
  CHECK(frame.write(three));
  auto moved = std::move(frame);
  CHECK(frame.boxes().empty() && moved.boxes().size() == 3);
  auto pending = std::move(moved).submit().value();
  auto mask = pm::Result<pm::Mask>(pm::Error(PM_ERR_TIMEOUT, ""));
  while (!mask && mask.error().code() == PM_ERR_TIMEOUT) {
    mask = pending.wait_for(1'000'000);
  }
  CHECK(are(mask->pairs(), {{0, 1}, {1, 2}}) && mask->contains(2, 1) && mask->count() == 2);
  CHECK(!pending.wait());
  CHECK(mask->info().n == 3);

#if __cplusplus >= 202002L
  const std::span<const pm::Pair> standard = mask->pairs();
  CHECK(standard.size() == 2);
#endif

#if PAIRMASK_HAS_EXCEPTIONS
  bool caught = false;
  try {
    mask->for_each([](auto) { throw 7; }).value();
  } catch (int seven) {
    caught = seven == 7;
  }
  CHECK(caught);
  caught = false;
  try {
    session.frame(3).value().write(pm::Span<const pm::Box>(three.data(), 2)).value();
  } catch (const std::exception &error) {
    caught = std::string(error.what()).find("2 boxes for a frame of 3") != std::string::npos;
  }
  CHECK(caught);
#endif

  auto wrong = session.frame(3).value().write(pm::Span<const pm::Box>(three.data(), 2));
  CHECK(!wrong && wrong.error().code() == PM_ERR_ARGUMENT);
  CHECK(strstr(wrong.error().what(), "PM_ERR_ARGUMENT: ") == wrong.error().what());

  auto between = session.frame(3).value();
  between.write(three).value();
  auto first = std::move(between).submit({nullptr, 1}).value().wait().value();
  CHECK(are(first.pairs(), {{0, 1}}));
  first = {};

  auto spheres = session.sphere_frame(2).value();
  spheres.spheres()[0] = {{0, 0, 0}, 1};
  spheres.spheres()[1] = {{2, 0, 0}, 1};
  CHECK(spheres.boxes().empty());
  CHECK(std::move(spheres).submit().value().wait().value().count() == 1);

  auto narrow = session.narrow_frame(3, {PM_FORM_Q16, pm::box(-9, -9, -9, 9, 9, 9)}).value();
  narrow.write(three).value();
  narrow.set(0, at(8)).value();
  CHECK(are(std::move(narrow).submit().value().wait().value().pairs(), {{1, 2}}));

  const pm::FilterData filter_data[] = {{0, 1, 0, 0}, {0, 1, 0, 0}, {0, 0, 0, 0}};
  auto rules = pm::Rules::create(filter_data).value();
  CHECK(are(session.cull(three, rules).value().pairs(), {{1, 2}}));
  auto with = session.frame(3).value();
  with.write(three).value();
  CHECK(std::move(with).submit({&rules}).value().wait().value().count() == 1);
  const pm::Rules empty;
  auto refused = session.frame(3).value().submit({&empty});
  CHECK(!refused && refused.error().code() == PM_ERR_HANDLE);

  CHECK(pm::outward({0.1, 0, 0}, {1, 1, 1}, {0, 0, 0}).min[0] <= 0.1f);
}

void scenes(pm::Session &session) {
  pm::SceneOptions options;
  options.most_boxes = 1000;
  auto scene = session.scene(options).value();
  scene.set(7, at(0)).value();
  scene.set(9, at(0.5f)).value();
  auto answer = scene.commit(PM_REPORT_CHANGES).value();
  CHECK(are(answer.begun(), {{7, 9}}) && answer.ended().empty() && answer.late().empty());
  CHECK(scene.query(std::vector<pm::Box>{at(0)}).value().size() == 2);
  const char *const path = "calls.pmscene";
  scene.save(path).value();
  CHECK(session.load_scene(path).value().query(std::vector<pm::Box>{at(0)}).value().size() == 2);
  CHECK(std::remove(path) == 0);
  CHECK(session.load_scene(path).error().code() == PM_ERR_SCENE_FILE);
  const std::vector<std::uint64_t> given = {77, 99};
  const std::vector<std::uint32_t> of_both = {9, 7};
  scene.set_user_data(pm::list(of_both), given).value();
  scene.commit(PM_REPORT_NOTHING).value();
  const pm::Span<const std::uint64_t> user_data = scene.user_data(of_both).value();
  CHECK(user_data.size() == 2 && user_data[0] == 77 && user_data[1] == 99);
  const std::uint64_t snapshot = scene.snapshot().value();
  scene.shift_origin(64, 0, 0).value();
  scene.restore(snapshot).value();
  CHECK(scene.query(std::vector<pm::Box>{at(0)}).value().size() == 2);
  scene.forget_snapshot(snapshot).value();
  CHECK(scene.restore(snapshot).error().code() == PM_ERR_SNAPSHOT);
  scene.shift_origin(64, 0, 0).value();
  scene.shift_origin(-64, 0, 0).value();
  CHECK(scene.shift_origin(1e9f, 0, 0).error().code() == PM_ERR_INEXACT_SHIFT);
  const float far = std::numeric_limits<float>::infinity();
  const std::vector<pm::Ray> rays = {{{-4, 0, 0}, {2, 0, 0}, far, {0, 0, 0}}};
  CHECK(scene.cast(rays, pm::Hits::all()).value().size() == 2);
  const pm::Span<const pm::Hit> hits = scene.cast(rays, pm::Hits::closest(1)).value();
  CHECK(hits.size() == 1 && hits[0].query == 0 && hits[0].distance == 2);
  CHECK(scene.cast(rays, pm::Hits::any()).value()[0].index == PM_ANY_BOX);
  const std::vector<pm::Sphere> spheres = {{{-4, 0, 0}, far}};
  CHECK(scene.nearest(spheres, pm::Hits::closest(1)).value()[0].distance == 4);
  scene.set_enabled(pm::index(7), false).value();
  scene.submit(PM_REPORT_CHANGES).value();
  answer = scene.wait().value();
  CHECK(answer.ended().size() == 1 && answer.ended()[0].reason == PM_ENDED_FILTERED);
  CHECK(scene.box(9).value().min[0] == 0.5f && !scene.box(8));
  CHECK(scene.info().boxes == 2 && scene.info().most_boxes == 1000);
  CHECK(scene.wait().value().ended().size() == 1); // box() and info() leave the answer alone
  scene.resync().value();
  const auto ended = scene.wait();
  CHECK(!ended && ended.error().code() == PM_ERR_STATE);
  const std::uint32_t both[] = {7, 9};
  scene.remove(pm::list(both)).value();
  answer = scene.commit(PM_REPORT_ALL).value();
  CHECK(answer.pairs().empty() && answer.all_pairs == 0);

  pm::SceneOptions with_margins;
  with_margins.margins = PM_MARGINS_EXACT;
  auto margined = session.scene(with_margins).value();
  const pm::Box boxes[] = {at(0), at(1.25f)};
  const float margin[] = {0.5f};
  margined.set_all(pm::range(0, 2), boxes, margin).value();
  CHECK(margined.commit(PM_REPORT_ALL).value().pairs().empty());
}

void shared(pm::Session &session, bool is_daemon) {
  auto joined = session.join_scene("arena-of-cpp");
  CHECK(static_cast<bool>(joined) == is_daemon);
  if (!joined) {
    CHECK(joined.error().code() == PM_ERR_IN_PROCESS);
    return;
  }
  auto scene = std::move(joined).value();
  const auto range = scene.lease_any(2).value();
  CHECK(range.count == 2 && scene.info().lease_count == 1);
  scene.set(range.first, at(0)).value();
  scene.set(range.first + 1, at(0.5f)).value();
  const auto answer = scene.commit(PM_REPORT_ALL).value();
  CHECK(answer.pairs().size() == 1 && answer.late().empty() && answer.tick > 0);
  scene.give_back(range.first).value();
}

} // namespace

int main(int argc, char **argv) {
  pm::SessionOptions options;
  static_cast<pm_session_options &>(options) = options_of(argc, argv);
  const bool is_daemon = options.backend == PM_BACKEND_DAEMON;
  auto session = pm::Session::connect(options).value();
  CHECK((session.served_by() == PM_SERVED_BY_DAEMON) == is_daemon);
  CHECK(!is_daemon || session.daemon_status().value().pid != 0);
  options.instance = "nobody-serves-this";
  options.backend = PM_BACKEND_DAEMON;
  CHECK(pm::Session::connect(options).error().code() == PM_ERR_NO_DAEMON);
  frames(session);
  scenes(session);
  shared(session, is_daemon);
  std::puts("all calls");
  return 0;
}
