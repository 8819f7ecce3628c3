// Bullet's engine with a broad phase, and scenes for it.
#ifndef WORLDS_HPP
#define WORLDS_HPP

#include <btBulletDynamicsCommon.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <vector>

// A world that measures its broad phase: boxes set, and pairs found.
class MeasuredWorld : public btDiscreteDynamicsWorld {
public:
  using btDiscreteDynamicsWorld::btDiscreteDynamicsWorld;

  void updateAabbs() override {
    const auto start = std::chrono::steady_clock::now();
    btDiscreteDynamicsWorld::updateAabbs();
    spent += std::chrono::steady_clock::now() - start;
  }
  void computeOverlappingPairs() override {
    const auto start = std::chrono::steady_clock::now();
    btDiscreteDynamicsWorld::computeOverlappingPairs();
    spent += std::chrono::steady_clock::now() - start;
  }

  std::chrono::steady_clock::duration spent{};
};

enum class SceneName { Stacks, Wall, Rain, Sizes, Movers };
constexpr SceneName ALL_SCENES[] = {SceneName::Stacks, SceneName::Wall, SceneName::Rain,
                                    SceneName::Sizes, SceneName::Movers};
constexpr const char *name_of(SceneName scene) {
  constexpr const char *names[] = {"stacks", "wall", "rain", "sizes", "movers"};
  return names[static_cast<int>(scene)];
}

// A simulation: the same bodies at the same places, regardless of the broad phase.
class Simulation {
public:
  Simulation(btBroadphaseInterface &broadphase, SceneName scene, int bodies)
      : dispatcher_(&configuration_), world(&dispatcher_, &broadphase, &solver_, &configuration_),
        scene_(scene) {
    world.setGravity(btVector3(0, -10, 0));
    ground_ = std::make_unique<btBoxShape>(btVector3(1000, 1, 1000));
    add(ground_.get(), 0, btVector3(0, -1, 0));
    cube_ = std::make_unique<btBoxShape>(btVector3(0.5f, 0.5f, 0.5f));
    ball_ = std::make_unique<btSphereShape>(btScalar(0.5));
    for (int i = 0; i < bodies; i++) {
      box_at(i, bodies);
    }
  }
  ~Simulation() {
    for (auto &body : bodies_) {
      world.removeRigidBody(body.get());
    }
  }

  void step() {
    if (scene_ == SceneName::Movers) {
      // Bodies that come and go, and some that are carried through the others.
      if (steps_ % 7 == 3 && bodies_.size() > 1) {
        const std::size_t box_at = 1 + static_cast<std::size_t>(steps_) % (bodies_.size() - 1);
        world.removeRigidBody(bodies_[box_at].get());
        bodies_.erase(bodies_.begin() + static_cast<std::ptrdiff_t>(box_at));
        add(cube_.get(), 1, btVector3(btScalar(steps_ % 20), 12, btScalar(steps_ % 13)));
      }
      for (std::size_t i = 1; i < bodies_.size(); i += 16) {
        btTransform at = bodies_[i]->getWorldTransform();
        at.setOrigin(at.getOrigin() + btVector3(btScalar(0.05), 0, 0));
        bodies_[i]->setWorldTransform(at);
      }
    }
    world.stepSimulation(btScalar(1.0 / 60), 0);
    steps_ += 1;
  }

  // A fingerprint of all bodies' places, bit by bit (FNV-1a).
  std::uint64_t fingerprint() const {
    std::uint64_t hash = 0xcbf29ce484222325u;
    for (const auto &body : bodies_) {
      const btTransform &at = body->getWorldTransform();
      const btVector3 &origin = at.getOrigin();
      const btQuaternion turned = at.getRotation();
      const btScalar values[] = {origin.x(), origin.y(), origin.z(), turned.x(),
                                 turned.y(), turned.z(), turned.w()};
      const auto *bytes = reinterpret_cast<const unsigned char *>(values);
      for (std::size_t i = 0; i < sizeof values; i++) {
        hash = (hash ^ bytes[i]) * 0x100000001b3u;
      }
    }
    return hash;
  }

  const std::vector<std::unique_ptr<btRigidBody>> &bodies() const { return bodies_; }

private:
  void add(btCollisionShape *shape, btScalar mass, const btVector3 &at) {
    btVector3 inertia(0, 0, 0);
    if (mass > 0) {
      shape->calculateLocalInertia(mass, inertia);
    }
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, shape, inertia);
    info.m_startWorldTransform.setIdentity();
    info.m_startWorldTransform.setOrigin(at);
    bodies_.push_back(std::make_unique<btRigidBody>(info));
    world.addRigidBody(bodies_.back().get());
  }

  void box_at(int i, int bodies) {
    const int side = static_cast<int>(std::ceil(std::sqrt(bodies / 8.0)));
    const int column = i % (side * side), height = i / (side * side);
    const btScalar x = btScalar(column % side), z = btScalar(column / side), y = btScalar(height);
    // Spread that has no pattern and is the same everywhere.
    const btScalar jitter = btScalar((i * 7919) % 1000) / 5000;
    switch (scene_) {
    case SceneName::Stacks:
      add(cube_.get(), 1, btVector3(x * btScalar(1.5), y + btScalar(0.5), z * btScalar(1.5)));
      break;
    case SceneName::Wall:
      add(cube_.get(), 1,
          btVector3(btScalar(i % 40) + btScalar(i / 40 % 2) / 2, btScalar(i / 40) + btScalar(0.5),
                    0));
      break;
    case SceneName::Rain:
      add(ball_.get(), 1,
          btVector3(x * btScalar(1.1) + jitter, 3 + y * 2, z * btScalar(1.1) + jitter));
      break;
    case SceneName::Sizes: {
      const btScalar half = btScalar(0.2) + btScalar(i % 9) / 10;
      shapes_.push_back(std::make_unique<btBoxShape>(btVector3(half, half, half)));
      add(shapes_.back().get(), half, btVector3(x * 2 + jitter, 2 + y * 3, z * 2 + jitter));
      break;
    }
    case SceneName::Movers:
      add(i % 2 == 0 ? static_cast<btCollisionShape *>(cube_.get()) : ball_.get(), 1,
          btVector3(x * btScalar(1.2), 1 + y * btScalar(1.2), z * btScalar(1.2)));
      break;
    }
  }

  btDefaultCollisionConfiguration configuration_;
  btCollisionDispatcher dispatcher_;
  btSequentialImpulseConstraintSolver solver_;
  std::unique_ptr<btCollisionShape> ground_, cube_, ball_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;

public:
  MeasuredWorld world;

private:
  SceneName scene_;
  std::vector<std::unique_ptr<btRigidBody>> bodies_;
  int steps_ = 0;
};

#endif
