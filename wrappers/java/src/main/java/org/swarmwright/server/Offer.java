package org.swarmwright.server;

import java.util.ArrayList;
import java.util.List;
import java.util.function.Supplier;
import org.swarmwright.Description;
import org.swarmwright.Simulation;
import org.swarmwright.extension.Refusal;

/** The simulation that a server offers, and the duplicates of it that a batch needs. */
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

  /** The titles of all simulations, as messages list them. */
  List<String> titles() {
    return List.of(description.title());
  }

  boolean offers(String title) {
    return description.title().equals(title);
  }

  /** Whether the simulation has scenes: its class has a method of its own for them. */
  boolean hasScenes() {
    try {
      return first().getClass().getMethod("scene").getDeclaringClass() != Simulation.class;
    } catch (NoSuchMethodException error) {
      return false;
    }
  }

  /** The largest number of episodes of a batch. */
  int maxBatch() {
    return maker == null ? 1 : MAX_BATCH;
  }

  Simulation first() {
    return simulations.get(0);
  }

  /**
   * Simulations for a number of episodes.
   *
   * @throws Refusal if they cannot be made
   */
  List<Simulation> several(int number) {
    if (number > maxBatch()) {
      throw new Refusal(
          Refusal.Kind.INVALID,
          "seeds: " + number + " episodes, but a batch here has at most " + maxBatch());
    }
    while (simulations.size() < number) {
      try {
        simulations.add(Guard.<Simulation>call(maker::get));
      } catch (Guard.EpisodeFailed | RuntimeException error) {
        throw new Refusal(
            Refusal.Kind.FAILED, "no simulation for another episode: " + error.getMessage());
      }
    }
    return List.copyOf(simulations.subList(0, number));
  }

  /** Removes the duplicates that only batches need. */
  void discardDuplicates() {
    simulations.subList(1, simulations.size()).clear();
  }
}
