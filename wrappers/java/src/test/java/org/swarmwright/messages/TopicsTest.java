package org.swarmwright.messages;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertNull;
import static org.junit.jupiter.api.Assertions.assertThrows;

import com.google.gson.JsonObject;
import java.util.Locale;
import org.junit.jupiter.api.Test;
import org.swarmwright.Vectors;
import org.swarmwright.messages.Topics.Topic;

class TopicsTest {
  private static final JsonObject VECTORS = Vectors.load("topics.json").getAsJsonObject();

  @Test
  void namesAreThoseOfTheVectors() {
    for (JsonObject vector : Vectors.objects(VECTORS.get("names"))) {
      Topics topics = new Topics(vector.get("prefix").getAsString());
      Topic topic = Topic.valueOf(vector.get("message").getAsString().toUpperCase(Locale.ROOT));
      String name = vector.get("topic").getAsString();
      assertEquals(topic, topics.parse(name), name);
      if (vector.has("server")) {
        assertEquals(name, topics.name(topic, vector.get("server").getAsLong()));
      } else if (vector.has("token")) {
        assertEquals(name, topics.under(topic.text() + "/" + vector.get("token").getAsString()));
      } else {
        assertEquals(name, topics.name(topic));
      }
    }
  }

  @Test
  void foreignNamesAreNoneOfOurs() {
    for (JsonObject vector : Vectors.objects(VECTORS.get("foreign"))) {
      Topics topics = new Topics(vector.get("prefix").getAsString());
      assertNull(topics.parse(vector.get("topic").getAsString()), vector.toString());
    }
  }

  @Test
  void prefixesThatCannotStandAreRefused() {
    for (JsonObject vector : Vectors.objects(VECTORS.get("refused_prefixes"))) {
      String prefix = vector.get("prefix").getAsString();
      assertThrows(IllegalArgumentException.class, () -> new Topics(prefix), prefix);
    }
  }
}
