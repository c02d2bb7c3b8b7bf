/* Prints the nearest obstacle in the path of each frame: nearest [INSTANCE [DIRECTORY [FRAMES]]] */
#include <lookout.h>
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **arguments) {
    long frames = count > 3 ? atol(arguments[3]) : -1;
    char error[256];
    lookout_options options = LOOKOUT_OPTIONS;
    options.instance = count > 1 ? arguments[1] : NULL;
    options.directory = count > 2 ? arguments[2] : NULL;
    options.pictures = 1;
    lookout_client *client = lookout_open(&options, error, sizeof error);
    if (!client)
        return fprintf(stderr, "%s\n", error), 1;

    lookout_frame frame;
    while (frames-- != 0 && lookout_next(client, 60000, &frame) == 1) {
        size_t known = 0;
        for (size_t i = 0; frame.disparity && i < (size_t)frame.width * frame.height; i++)
            known += frame.disparity[i] > 0;
        for (uint32_t i = 0; i < frame.obstacle_count; i++)
            if (frame.obstacles[i].track == frame.alarm->object)
                printf("%llu %s %.1f m, %zu disparities\n", (unsigned long long)frame.sequence,
                       lookout_level_name(frame.alarm->level), frame.obstacles[i].distance_m, known);
    }
    const char *reason = lookout_error(client);
    if (*reason)
        fprintf(stderr, "%s\n", reason);
    int failed = *reason != 0;
    lookout_close(client);
    return failed;
}
