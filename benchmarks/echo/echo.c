/* The floor: every datagram goes back as it came. One blocking thread, nothing decoded. Usage: echo PORT */
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>

int main(int argc, char **argv)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int fd = socket(AF_INET, SOCK_DGRAM, 0);
    if (argc != 2 || fd < 0)
        return 2;
    address.sin_port = htons((unsigned short)atoi(argv[1]));
    if (bind(fd, (struct sockaddr *)&address, sizeof address) != 0)
        return 2;
    puts("ready");
    fflush(stdout);
    for (;;) {
        char data[2048];
        struct sockaddr_in peer;
        socklen_t size = sizeof peer;
        ssize_t got = recvfrom(fd, data, sizeof data, 0, (struct sockaddr *)&peer, &size);
        if (got < 0)
            return 1;
        sendto(fd, data, (size_t)got, 0, (struct sockaddr *)&peer, size);
    }
}
