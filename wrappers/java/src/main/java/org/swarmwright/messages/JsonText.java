package org.swarmwright.messages;

import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonParseException;
import com.google.gson.Strictness;
import com.google.gson.TypeAdapter;
import com.google.gson.internal.bind.TypeAdapters;
import com.google.gson.stream.JsonReader;
import com.google.gson.stream.JsonToken;
import com.google.gson.stream.MalformedJsonException;
import java.io.IOException;
import java.io.StringReader;
import java.nio.ByteBuffer;
import java.nio.charset.CharacterCodingException;
import java.nio.charset.StandardCharsets;
import java.util.Map;

/** Reads payloads as strictly as JSON is written down (RFC 8259); of repeated keys the last one counts. */
final class JsonText {
  /** Larger payloads are refused unread, bytes. */
  static final int MAX_PAYLOAD = 1 << 20;

  private static final int MAX_NESTING = 127;
  private static final TypeAdapter<JsonElement> ELEMENTS = TypeAdapters.JSON_ELEMENT;

  private JsonText() {}

  /**
   * Reads one JSON object.
   *
   * @throws MessageException if the payload is too large, no UTF-8, no JSON or no object
   */
  static JsonObject read(byte[] payload) {
    if (payload.length > MAX_PAYLOAD) {
      throw new MessageException(payload.length + " bytes are more than the " + MAX_PAYLOAD + " of a message");
    }
    String text = utf8(payload);
    if (text.startsWith("\uFEFF")) {
      throw new MessageException("no JSON: it begins with a byte order mark");
    }
    JsonReader reader = new JsonReader(new StringReader(text));
    reader.setStrictness(Strictness.STRICT);
    reader.setNestingLimit(MAX_NESTING);
    JsonElement element;
    try {
      element = ELEMENTS.read(reader);
      if (reader.peek() != JsonToken.END_DOCUMENT) {
        throw new MessageException("more than one JSON object");
      }
    } catch (MalformedJsonException | JsonParseException error) {
      throw new MessageException("no JSON: " + error.getMessage());
    } catch (IOException | IllegalStateException | NumberFormatException error) {
      throw new MessageException("no JSON: " + error.getMessage());
    }
    if (!element.isJsonObject()) {
      throw new MessageException("no JSON object");
    }
    // Only an escape can make half a surrogate pair of what was UTF-8.
    if (text.contains("\\u")) {
      checkUnicode(element);
    }
    return element.getAsJsonObject();
  }

  private static String utf8(byte[] payload) {
    try {
      return StandardCharsets.UTF_8.newDecoder().decode(ByteBuffer.wrap(payload)).toString();
    } catch (CharacterCodingException error) {
      throw new MessageException("no UTF-8");
    }
  }

  private static void checkUnicode(JsonElement element) {
    if (element.isJsonObject()) {
      for (Map.Entry<String, JsonElement> entry : element.getAsJsonObject().entrySet()) {
        checkUnicode(entry.getKey());
        checkUnicode(entry.getValue());
      }
    } else if (element.isJsonArray()) {
      element.getAsJsonArray().forEach(JsonText::checkUnicode);
    } else if (element.isJsonPrimitive() && element.getAsJsonPrimitive().isString()) {
      checkUnicode(element.getAsString());
    }
  }

  private static void checkUnicode(String text) {
    boolean alone = text.codePoints().anyMatch(point -> point >= 0xD800 && point <= 0xDFFF);
    if (alone) {
      throw new MessageException("half a surrogate pair is no Unicode");
    }
  }
}
