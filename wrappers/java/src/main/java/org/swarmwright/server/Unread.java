package org.swarmwright.server;

import java.util.HashSet;
import java.util.Set;
import java.util.function.Consumer;
import org.swarmwright.ParameterReader;

/** Warns of parameters that a simulation does not read, once of each; used by several threads. */
final class Unread {
  private static final int MAX_TOLD = 100;
  private static final int MAX_NAME = 100;

  private final Consumer<String> notices;
  private final Set<String> reported = new HashSet<>();

  Unread(Consumer<String> notices) {
    this.notices = notices;
  }

  /** Looks at the parameters of an episode that was reset. */
  synchronized void check(ParameterReader parameters) {
    for (String name : parameters.unread()) {
      if (reported.size() < MAX_TOLD && reported.add(name)) {
        notices.accept(
            "warning: the parameter "
                + Guard.shortened(name, MAX_NAME)
                + " has no effect: the simulation does not read it; is it misspelt?");
      }
    }
  }
}
