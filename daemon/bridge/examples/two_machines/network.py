"""A network of machines that delays and loses packets, which not every kernel can: as root, in a namespace of its own.

    network.py switch DELAY_MS LOSS PORT..   carries frames between interfaces; reads lines `part G..`: a port of
                                             another group is not reached; and `cut A B`: two are
                                             not reached by each other, until the next line
    network.py plain INTERFACE               has packets leave an interface as they are on a cable: no longer than its
                                             MTU, with their checksums
"""

import array, fcntl, heapq, random, selectors, socket, struct, sys, time

# From linux/sockios.h, linux/ethtool.h and linux/if_packet.h.
SIOCETHTOOL = 0x8946
ETHTOOL_STXCSUM, ETHTOOL_STSO, ETHTOOL_SGSO = 0x17, 0x1F, 0x24
ETH_P_ALL, PACKET_OUTGOING = 3, 4


def plain(interface):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        for command in (ETHTOOL_STSO, ETHTOOL_SGSO, ETHTOOL_STXCSUM):
            value = array.array("B", struct.pack("II", command, 0))
            request = struct.pack("16sP", interface.encode(), value.buffer_info()[0])
            fcntl.ioctl(control, SIOCETHTOOL, request)


def mac(machine):
    return bytes([2, 0, 0, 0, 0, machine])


def switch(delay, loss, ports):
    selector, sockets = selectors.DefaultSelector(), []
    for at, port in enumerate(ports):
        link = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
        link.bind((port, 0))
        link.setblocking(False)
        selector.register(link, selectors.EVENT_READ, at)
        sockets.append(link)
    selector.register(sys.stdin, selectors.EVENT_READ, None)
    groups, cut, on_the_way, sent, chance = [0] * len(ports), set(), [], 0, random.Random(1)
    print("carries", flush=True)
    while True:
        now = time.monotonic()
        while on_the_way and on_the_way[0][0] <= now:
            _, _, to, frame = heapq.heappop(on_the_way)
            try:
                sockets[to].send(frame)
            except OSError:
                pass  # The interface is down, or its queue is full: the frame is lost.
        wait = on_the_way[0][0] - now if on_the_way else 0.1
        for key, _ in selector.select(wait):
            if key.data is None:
                words = sys.stdin.readline().split()
                if words[:1] == ["part"]:
                    groups, cut = [int(group) for group in words[1:]], set()
                elif words[:1] == ["cut"]:
                    cut = {int(machine) for machine in words[1:]}
                elif not words:
                    selector.unregister(sys.stdin)
                continue
            while True:
                try:
                    frame, address = key.fileobj.recvfrom(65_536)
                except BlockingIOError:
                    break
                if address[2] == PACKET_OUTGOING:
                    continue
                receivers = range(len(ports))
                if frame[:5] == mac(0)[:5]:
                    receivers = [frame[5]] if frame[5] < len(ports) else []
                for to in receivers:
                    if to == key.data or groups[to] != groups[key.data] or {to, key.data} == cut:
                        continue
                    if chance.random() >= loss:
                        sent += 1
                        heapq.heappush(on_the_way, (time.monotonic() + delay, sent, to, frame))


if __name__ == "__main__":
    if sys.argv[1] == "plain":
        plain(sys.argv[2])
    else:
        switch(float(sys.argv[2]) / 1e3, float(sys.argv[3]), sys.argv[4:])
