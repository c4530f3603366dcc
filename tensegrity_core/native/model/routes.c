/* Strings over more than two nodes, and the shares that nodes have in strings' masses.
 *
 * A routed string is one string: one law, one rest length, one tension.  Its segments are lines behind those of the strings; each
 * has ends and terms as a string from node to node has, and the routed string itself has none, so that what is worked out for all
 * lines alike gives its segments' vectors and lengths, and nothing for itself. */
#include "model/routes.h"
#include "invariants.h"
#include "linear/pattern.h"

#include <stdint.h>

/* The next route of a packed model: at its string, the number of its nodes, and the nodes. */
static const int32_t *next_route(const int32_t *route) { return route + 2 + route[1]; }

/* Room for the blocks of n nodes: each hangs on two at most. */
static size_t room(int32_t n) { return 2 * (size_t)n; }

static const char *check_route(const ts_model *m, const int32_t *route, const int32_t *end)
{
    if (end - route < 2 || route[1] < 3 || route[1] > end - route - 2) return "a routed string is damaged";
    if (route[0] < 0 || route[0] >= m->count[TS_S]) return "a route names an unknown string";
    const int32_t *node = route + 2;
    for (int k = 0; k < route[1]; k++)
        if (node[k] < 0 || node[k] >= m->count[TS_N]) return "a route names an unknown node";
    for (int k = 1; k < route[1]; k++)
        if (node[k] == node[k - 1]) return "a routed string runs from a node to itself";
    return NULL;
}

/* Check routes, shares and strings that push, so that a damaged file cannot lead outside the arrays.  A reason, or NULL. */
const char *ts_check_routes(const ts_model *m)
{
    const ts_packed *p = &m->packed;
    const int32_t *route = p->route, *end = route + p->route_ints;
    const char *reason;
    size_t places = 0;
    for (int r = 0, last = -1; r < p->routes; r++, last = route[0], route = next_route(route)) {
        if ((reason = check_route(m, route, end))) return reason;
        if (route[0] <= last) return "the routed strings are not in order";
        places += room(route[1]) * room(route[1]);
        if (places > INT32_MAX) return "the routed strings run over too many nodes";
    }
    if (route != end) return "the routed strings do not add up";
    for (int i = 0; i < p->shares; i++) {
        if (p->sharing[2 * i] < 0 || p->sharing[2 * i] >= m->count[TS_M]) return "a share names an unknown string";
        if (p->sharing[2 * i + 1] < 0 || p->sharing[2 * i + 1] >= m->count[TS_N]) return "a share names an unknown node";
        if (!(p->share[i] >= 0.0 && p->share[i] <= 1.0)) return "a share of a string's mass is out of range";
    }
    for (int i = 0; i < p->two_way_count; i++) {
        const int string = p->two_way[i];
        if (string < 0 || string >= m->count[TS_S]) return "a string that pushes is unknown";
        if (p->beams[string] || p->element[2 * string] >= 0) return "a string that pushes is no spring";
    }
    return NULL;
}

int ts_segment_count(const ts_model *m)
{
    const int32_t *route = m->packed.route;
    int count = 0;
    for (int r = 0; r < m->packed.routes; r++, route = next_route(route)) count += route[1] - 1;
    return count;
}

/* Room for the blocks that all routes hang on. */
size_t ts_route_blocks(const ts_model *m)
{
    const int32_t *route = m->packed.route;
    size_t count = 0;
    for (int r = 0; r < m->packed.routes; r++, route = next_route(route)) count += room(route[1]);
    return count;
}

/* Room for the places of all pairs of them, route by route. */
size_t ts_route_places(const ts_model *m)
{
    const int32_t *route = m->packed.route;
    size_t count = 0;
    for (int r = 0; r < m->packed.routes; r++, route = next_route(route)) count += room(route[1]) * room(route[1]);
    return count;
}

/* Which lines are whose segments, and between which nodes. */
void ts_lay_out_routes(ts_model *m)
{
    const int32_t *route = m->packed.route;
    ts_lines *lines = &m->string;
    int line = m->count[TS_S];
    size_t block = 0, place = 0;
    for (int i = 0; i < m->count[TS_S]; i++) lines->routed[i] = -1;
    for (int i = 0; i < m->packed.two_way_count; i++) lines->two_way[m->packed.two_way[i]] = 1;
    for (int r = 0; r < lines->route_count; r++, route = next_route(route)) {
        ts_route *found = lines->route + r;
        const int32_t n = route[1];
        found->string = route[0];
        found->first = line;
        found->count = n - 1;
        found->block = lines->route_blocks + block;
        found->place = lines->route_places + place;
        lines->routed[found->string] = r;
        lines->node[2 * found->string + 1] = lines->node[2 * found->string]; /* no ends */
        for (int k = 0; k + 1 < n; k++, line++)
            for (int end = 0; end < 2; end++) lines->node[2 * line + end] = route[2 + k + end];
        block += room(n);
        place += room(n) * room(n);
    }
    lines->otherwise = m->packed.two_way_count + lines->route_count > 0;
    TS_ASSERT(line == lines->count);
}

/* The blocks that each route hangs on, in the order of its terms. */
void ts_list_route_blocks(ts_model *m)
{
    ts_lines *lines = &m->string;
    lines->most_blocks = 0;
    for (int r = 0; r < lines->route_count; r++) {
        ts_route *route = lines->route + r;
        route->blocks = 0;
        for (int line = route->first; line < route->first + route->count; line++)
            for (int k = 0; k < lines->term_count[line]; k++) {
                const int32_t block = lines->term[4 * line + k].block;
                int at = 0;
                while (at < route->blocks && route->block[at] != block) at++;
                if (at == route->blocks) route->block[route->blocks++] = block;
                lines->term_block[4 * line + k] = at;
            }
        if (route->blocks > lines->most_blocks) lines->most_blocks = route->blocks;
    }
}

/* Where the Jacobian has the blocks for each pair of them. */
void ts_place_routes(ts_model *m, const ts_pattern *pattern)
{
    for (int r = 0; r < m->string.route_count; r++) {
        const ts_route *route = m->string.route + r;
        for (int a = 0; a < route->blocks; a++)
            for (int b = 0; b < route->blocks; b++)
                route->place[a * route->blocks + b] = ts_pattern_place(pattern, route->block[a], route->block[b]);
    }
}

/* Nodes that have a mass beside their bar's, each once; known: (N) zeros. */
void ts_lay_out_masses(ts_model *m, int32_t *known)
{
    const ts_packed *p = &m->packed;
    int count = 0;
    for (int i = 0; i < m->count[TS_P] + p->shares; i++) {
        const int node = i < m->count[TS_P] ? p->massed[i] : p->sharing[2 * (i - m->count[TS_P]) + 1];
        if (known[node]) continue;
        known[node] = 1;
        m->node.massed[count++] = node;
    }
    m->node.massed_count = count;
}
