package org.swarmwright.server;

import java.util.ArrayDeque;
import java.util.Deque;
import org.swarmwright.extension.MapReader;

/** Requests for offloaded evaluation of the tool that has the server. */
final class Work {
  private static final int MOST_WAITING = 4096;
  private static final long MOST_BYTES = 4L * MapReader.MAX_BLOCK;

  private String tool;
  private final Deque<Job> waiting = new ArrayDeque<>();
  private Job current;
  private long bytes;
  private boolean givenUp;

  Work(String tool, Job first) {
    this.tool = tool;
    current = first;
  }

  /** Who has the server; null once the work was given up, until somebody asks again. */
  String holder() {
    return tool;
  }

  /** Whether nobody waits for what has been computed; what comes next is waited for. */
  boolean wasGivenUp() {
    boolean before = givenUp;
    givenUp = false;
    return before;
  }

  /** Takes a request of a tool; where work was given up, it follows as soon as that has stopped. */
  void add(String asking, Job job) {
    tool = asking;
    bytes += job.size();
    waiting.add(job);
  }

  /** The next one, which is then under way; null if there is none. */
  Job next() {
    current = waiting.poll();
    if (current != null) {
      bytes -= current.size();
    }
    return current;
  }

  /** Gives everything up; what is being computed, as soon as it can be stopped. */
  void release() {
    tool = null;
    givenUp = true;
    waiting.clear();
    bytes = 0;
    if (current != null) {
      current.abort();
    }
  }

  /** Why no request of a tool is taken now; null if one is. */
  String taken(String other) {
    if (tool != null && !tool.equals(other)) {
      return "taken by " + tool;
    }
    return waiting.size() >= MOST_WAITING || bytes >= MOST_BYTES
        ? waiting.size() + " requests of this tool are waiting"
        : null;
  }
}
