// As conformance.c, through the interface of C++.
#include "pairmask.hpp"

#include "check.h"

#include <vector>

int main(int argc, char **argv) {
  const pm_session_options given = options_of(argc, argv);
  pairmask::SessionOptions options;
  options.backend = given.backend;
  options.runtime_dir = given.runtime_dir;
  options.encoding = given.encoding;
  auto session = pairmask::Session::connect(options).value();
  std::uint32_t n = 0;
  while (std::fread(&n, sizeof n, 1, stdin) == 1) {
    auto frame = session.frame(n).value();
    const auto boxes = frame.boxes();
    CHECK(boxes.size() == n);
    CHECK(std::fread(boxes.data(), sizeof(pairmask::Box), n, stdin) == n);
    auto mask = std::move(frame).submit().value().wait().value();
    std::vector<pairmask::Pair> pairs;
    mask.for_each([&](pairmask::Span<const pairmask::Pair> some) {
          pairs.insert(pairs.end(), some.begin(), some.end());
        })
        .value();
    std::size_t at = 0;
    for (const auto [a, b] : mask.pairs()) {
      CHECK(at < pairs.size() && pairs[at].a == a && pairs[at].b == b);
      at += 1;
    }
    CHECK(at == pairs.size() && at == mask.count());
    const auto info = mask.info();
    const std::uint32_t head[4] = {static_cast<std::uint32_t>(at), info.empty, info.invalid,
                                   info.served_by};
    CHECK(std::fwrite(head, sizeof head, 1, stdout) == 1);
    CHECK(at == 0 || std::fwrite(pairs.data(), sizeof pairs[0], at, stdout) == at);
    CHECK(std::fflush(stdout) == 0);
  }
  return 0;
}
