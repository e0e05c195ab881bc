package org.swarmwright.server;

import java.util.ArrayList;
import java.util.List;
import java.util.function.Supplier;
import org.swarmwright.Description;
import org.swarmwright.Simulation;
import org.swarmwright.extension.Refusal;

/** The simulation that a server offers, and as many more of its kind as a batch needs. */
final class Offer {
  static final int MAX_BATCH = 256;

  /** How another simulation is made; null if there can be only this one. */
  private final Supplier<? extends Simulation> maker;

  private final Description description;
  private final List<Simulation> simulations = new ArrayList<>();

  private Offer(Simulation first, Supplier<? extends Simulation> maker) {
    this.maker = maker;
    description = first.description();
    simulations.add(first);
  }

  static Offer of(Simulation only) {
    return new Offer(only, null);
  }

  static Offer of(Supplier<? extends Simulation> maker) {
    return new Offer(maker.get(), maker);
  }

  Description description() {
    return description;
  }

  /** Most episodes of a batch. */
  int batch() {
    return maker == null ? 1 : MAX_BATCH;
  }

  Simulation first() {
    return simulations.get(0);
  }

  /**
   * Simulations for so many episodes.
   *
   * @throws Refusal if they cannot be made
   */
  List<Simulation> several(int number) {
    if (number > batch()) {
      throw new Refusal(
          Refusal.Kind.INVALID,
          "seeds: " + number + " episodes, but a batch here has at most " + batch());
    }
    while (simulations.size() < number) {
      try {
        simulations.add(Guard.<Simulation>call(maker::get));
      } catch (Guard.Broken | RuntimeException error) {
        throw new Refusal(
            Refusal.Kind.FAILED, "no simulation for another episode: " + error.getMessage());
      }
    }
    return List.copyOf(simulations.subList(0, number));
  }

  /** Forgets what only batches need. */
  void tidy() {
    simulations.subList(1, simulations.size()).clear();
  }
}
