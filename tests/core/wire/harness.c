#include "{header}"
#include <stdio.h>
#include <string.h>

static int failures;

static void expect(const char *name, int holds) {{
    if (!holds) {{
        printf("FAILED %s\n", name);
        failures++;
    }}
}}

static void expect_frame(const char *name, const uint8_t *frame, size_t size, const uint8_t *hex, size_t hex_size) {{
    size_t intact = 0;
    expect(name, size == hex_size && memcmp(frame, hex, size) == 0);
    expect(name, tl_check(hex, hex_size, &intact) == TL_INTACT && intact == hex_size);
    for (size_t i = 0; i < hex_size; i++) {{
        expect(name, tl_check(hex, i, &intact) == TL_INCOMPLETE);
    }}
}}

static void expect_stream(const char *name, const uint8_t *data, size_t size, const size_t expected[4]) {{
    size_t found[4] = {{0, 0, 0, 0}};
    for (size_t at = 0; at < size;) {{
        size_t frame_size = 0;
        switch (tl_check(data + at, size - at, &frame_size)) {{
        case TL_INTACT:
            found[0]++;
            at += frame_size;
            continue;
        case TL_BAD_CRC:
            found[1]++;
            break;
        case TL_INCOMPLETE:
            found[3] += size - at > 1;
            break;
        case TL_NO_FRAME:
            break;
        }}
        found[2]++;
        at++;
    }}
    expect(name, memcmp(found, expected, sizeof found) == 0);
}}

int main(void) {{
    uint8_t *frame = (uint8_t[TL_MAX_FRAME_BYTES]){{0}};
    (void)frame;
    (void)expect_frame;
    (void)expect_stream;
{body}
    return failures != 0;
}}
