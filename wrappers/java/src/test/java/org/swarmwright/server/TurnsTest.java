package org.swarmwright.server;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertFalse;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.io.IOException;
import java.util.List;
import java.util.stream.Collectors;
import org.junit.jupiter.api.Test;

/** Several optimization tools that want one server, with and without names. */
class TurnsTest extends MachineFixture {
  private static final long MILLISECOND = SECOND / 1000;
  private static final String ADA = ", 'tool': 'ada'";
  private static final String BOB = ", 'tool': 'bob'";

  private long requests;

  private void pass(long time) {
    now += time;
    Long tick = machine.nextTick();
    if (tick != null && tick <= now) {
      machine.tick(now, "");
    }
  }

  /** The hashes of the answers to discoveries since the last call. */
  private List<String> answered() {
    List<String> hashes =
        out.published.stream()
            .filter(said -> said.startsWith("server "))
            .map(said -> said.replaceAll(".*\"simulation_hash\":\"([^\"]*)\".*", "$1"))
            .collect(Collectors.toList());
    out.published.clear();
    return hashes;
  }

  private void ask(String hash, String asker) {
    say(
        "discovery",
        "'simulation': 'walk', 'simulation_hash': '"
            + hash
            + "', 'requirements': {'dimensions': 2}"
            + asker);
  }

  /** A tool evaluates for a time, one request after another; how many were served. */
  private int busyFor(String tool, long time) throws IOException {
    int served = 0;
    for (long end = now + time; now < end; ) {
      evaluate(++requests, tool, 0, 1);
      pass(20 * MILLISECOND);
      if (!out.jobs.isEmpty()) {
        work();
      }
      served += out.error().equals("null") ? 1 : 0;
    }
    return served;
  }

  /** An episode of a tool, from parameters to fitness; whether it came to that. */
  private boolean episode(String hash, String asker) {
    out.published.clear();
    startAndStep(hash, "", asker);
    return out.published.stream().anyMatch(said -> said.startsWith("fitness "));
  }

  @Test
  void aToolWithANameHasItsTurnAfterFiveSeconds() throws IOException {
    assertTrue(busyFor("ada", SECOND) > 40);
    for (int second = 0; second < 3; second++) {
      assertFalse(isFree(BOB), "ada's turn");
      busyFor("ada", SECOND);
    }
    assertFalse(isFree(BOB), "ada's turn");
    out.published.clear();
    busyFor("ada", 3 * SECOND / 2);
    assertTrue(out.published.contains("presence"), "bob hears of it");
    assertEquals(0, busyFor("ada", SECOND / 4));
    assertFalse(isFree(ADA));
    assertTrue(isFree(BOB));
    assertTrue(busyFor("bob", SECOND) > 40);
  }

  @Test
  void requestsThatWaitAreAnsweredWhenTheTurnEnds() throws IOException {
    evaluate(1, "ada", 0, 1);
    evaluate(2, "ada", 0, 1);
    evaluate(3, "ada", 0, 1);
    pass(4 * SECOND);
    assertFalse(isFree(BOB));
    pass(2 * SECOND);
    work();
    assertEquals(3, out.replies.size(), "the one that was computed, and two that were not");
    assertTrue(out.error().contains("it is the turn of bob"), out.error());
    assertTrue(out.error().contains("taken"), out.error());
    assertTrue(out.jobs.isEmpty());
    assertTrue(isFree(BOB));
  }

  @Test
  void episodesHaveTurnsToo() {
    long end = now + 6 * SECOND;
    int episodes = 0;
    while (now < end) {
      isFree(BOB);
      episodes += episode("a" + now, ADA) ? 1 : 0;
      pass(100 * MILLISECOND);
    }
    assertTrue(48 <= episodes && episodes <= 51, episodes + " episodes of 0.1 s");
    assertTrue(episode("b", BOB));
    assertFalse(episode("c", ADA));
  }

  @Test
  void aToolWithoutANameThatAsksOnceHasItsTurn() throws IOException {
    busyFor("ada", SECOND);
    out.published.clear();
    ask("plain", "");
    busyFor("ada", 3 * SECOND);
    assertEquals(List.of(), answered(), "ada's turn");
    busyFor("ada", 3 * SECOND / 2);
    assertEquals(List.of("plain"), answered());
    assertEquals(0, busyFor("ada", SECOND / 4), "it waits for the one that was answered");
    assertTrue(episode("plain", "") && episode("its next", ""));
    assertFalse(isFree(ADA));
    assertTrue(isFree(""));
    pass(11 * SECOND / 10);
    assertTrue(isFree(ADA), "free for all again");
    assertTrue(busyFor("ada", SECOND) > 40);
  }

  @Test
  void aToolWithoutANameThatIsWaitedForMayEndIt() throws IOException {
    busyFor("ada", SECOND);
    ask("plain", "");
    busyFor("ada", 9 * SECOND / 2);
    say("parameters", "'server': 7, 'simulation_hash': 'plain'");
    say("control", "'server': 7, 'simulation_hash': 'plain', 'run': false");
    assertTrue(isFree(ADA));
  }

  @Test
  void theTurnOfAToolWithoutANameEnds() throws IOException {
    busyFor("ada", SECOND);
    ask("plain", "");
    busyFor("ada", 9 * SECOND / 2);
    int episodes = 0;
    while (episodes < 1000 && !isFree(ADA) && episode("plain" + episodes, "")) {
      episodes++;
      pass(100 * MILLISECOND);
    }
    assertTrue(45 <= episodes && episodes <= 55, episodes + " episodes of 0.1 s");
  }

  @Test
  void theServerWaitsNoLongerForAToolThatHasChosenAnother() throws IOException {
    for (boolean invited : new boolean[] {false, true}) {
      busyFor("ada", SECOND);
      out.published.clear();
      ask("plain", "");
      busyFor("ada", invited ? 9 * SECOND / 2 : SECOND);
      say("parameters", "'server': 8, 'simulation_hash': 'plain'");
      assertTrue(busyFor("ada", SECOND) > 40, "invited: " + invited);
      busyFor("ada", 6 * SECOND);
      assertEquals(invited ? 1 : 0, answered().size());
      pass(6 * SECOND);
    }
  }

  @Test
  void anAnswerThatNobodyTakesUpKeepsTheServerForASecond() throws IOException {
    busyFor("ada", SECOND);
    ask("plain", "");
    int served = busyFor("ada", 9 * SECOND);
    assertTrue(8 * 45 <= served && served < 8 * 50 + 10, served + " served");
  }
}
