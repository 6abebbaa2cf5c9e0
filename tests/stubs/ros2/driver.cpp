// Matrix and vectors of the plugin at one state from standard input.
#include <inverse_dynamics_solver/inverse_dynamics_solver.hpp>

#include <exception>
#include <iostream>

inverse_dynamics_solver::InverseDynamicsSolver * make_plugin();

static void print(const Eigen::MatrixXd & values)
{
    for (long k = 0; k < values.size(); ++k) {
        std::cout << values.data()[k] << "\n";
    }
}

int main()
{
    int n;
    std::cin >> n;
    Eigen::VectorXd q(n), dq(n), ddq(n);
    for (auto * x : {&q, &dq, &ddq}) {
        for (int k = 0; k < n; ++k) {
            std::cin >> x->data()[k];
        }
    }
    std::cout.precision(17);
    const std::unique_ptr<inverse_dynamics_solver::InverseDynamicsSolver> solver(make_plugin());
    try {
        solver->initialize();
        print(solver->getTorques(q, dq, ddq));
        print(solver->getCoriolisVector(q, dq));
        print(solver->getGravityVector(q));
        print(solver->getInertiaMatrix(q));
        print(solver->getFrictionVector(dq));
    } catch (const std::exception & error) {
        std::cerr << error.what();
        return 1;
    }
}
