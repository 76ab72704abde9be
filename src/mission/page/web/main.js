const data = JSON.parse(document.getElementById('data').textContent);
window.overfly = {
    show(next) {
        document.getElementById('raw').textContent = next.flights.map((flight) => flight.label).join(', ');
    },
    onPick() {},
};
window.overfly.show(data);
