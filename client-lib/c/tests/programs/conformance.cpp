// As conformance.c, through the interface of C++.
#include "pairmask.hpp"

#include "check.h"

#include <algorithm>
#include <chrono>
#include <vector>

namespace {

pairmask::Mask culled(pairmask::Session &session, const std::vector<pairmask::Box> &given) {
  auto frame = session.frame(given.size()).value();
  CHECK(frame.boxes().size() == given.size());
  std::copy(given.begin(), given.end(), frame.boxes().begin());
  return std::move(frame).submit().value().wait().value();
}

void append(std::vector<pairmask::Pair> &pairs, const pairmask::Mask &mask) {
  pairs.clear();
  mask.for_each([&](auto some) { pairs.insert(pairs.end(), some.begin(), some.end()); }).value();
}

} // namespace

int main(int argc, char **argv) {
  pairmask::SessionOptions options;
  static_cast<pm_session_options &>(options) = options_of(argc, argv);
  auto session = pairmask::Session::connect(options).value();
  std::uint32_t given[2];
  std::vector<pairmask::Pair> pairs;
  while (std::fread(given, sizeof given, 1, stdin) == 1) {
    std::vector<pairmask::Box> boxes(given[0]);
    CHECK(std::fread(boxes.data(), sizeof(pairmask::Box), boxes.size(), stdin) == boxes.size());
    auto mask = culled(session, boxes);
    append(pairs, mask);
    const auto all = mask.pairs();
    CHECK(all.size() == pairs.size() && all.size() == mask.count());
    CHECK(std::equal(all.begin(), all.end(), pairs.begin(),
                     [](auto x, auto y) { return x.a == y.a && x.b == y.b; }));
    const auto info = mask.info();
    mask = {};

    const auto start = std::chrono::steady_clock::now();
    for (std::uint32_t i = 0; i < given[1]; i++) {
      append(pairs, culled(session, boxes));
    }
    const std::chrono::nanoseconds taken = std::chrono::steady_clock::now() - start;
    const std::uint64_t head[] = {pairs.size(), info.empty, info.invalid, info.served_by,
                                  static_cast<std::uint64_t>(taken.count())};
    CHECK(std::fwrite(head, sizeof head, 1, stdout) == 1);
    CHECK(pairs.empty() || std::fwrite(pairs.data(), sizeof pairs[0], pairs.size(), stdout) == pairs.size());
    CHECK(std::fflush(stdout) == 0);
  }
  return 0;
}
